"""The locked wire: Algorithm 1 of the paper, in arc-length coordinates."""
