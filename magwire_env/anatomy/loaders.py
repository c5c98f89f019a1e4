"""Centrelines from other tools' files (CSV, VMTK ``.vtp``, 3D Slicer ``.mrk.json``); `Tract.load` is the way in."""

from ..physics.centreline_files import Centreline, read_centreline

__all__ = ["Centreline", "read_centreline"]
