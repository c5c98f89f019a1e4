"""The free wire: a rod in space inside a lumen that it may touch, pushed, pulled and turned."""
