"""Rows F1 to F22: the free wire against closed forms and published figures."""
