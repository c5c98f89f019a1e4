"""Doctests are not looked for in modules that need a neighbour."""

collect_ignore = ["mujoco_cable.py", "pyelastica.py"]
