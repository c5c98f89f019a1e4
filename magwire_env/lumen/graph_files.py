"""Trees in files that give nodes and the edges between them, SWC and JSON graphs, as lines from fork to fork."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .files import UNITS
from .reading import decoded_text
from .tree_lines import FoundLines, TreeLine

__all__ = ["read_graph", "read_swc"]

_MOST_NODES = 2_000_000


def read_swc(path: Path) -> FoundLines:
    """SWC: ``number type x y z radius parent`` a line; parent −1 begins a tree.

    Raises `ValueError` naming the file and what is wrong in it.
    """
    at: dict[int, int] = {}
    rows: list[list[float]] = []
    parents: list[int] = []
    for number, line in enumerate(decoded_text(path).splitlines(), 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            node, parent = int(words[0]), int(words[6])
            rows.append([float(w) for w in words[2:6]])
        except (ValueError, IndexError):
            raise ValueError(
                f"{path} line {number} must be 'number type x y z radius parent', got {line[:60]!r}"
            ) from None
        if node in at:
            raise ValueError(f"{path} line {number} must number its nodes once, got {node} again")
        at[node] = len(parents)
        parents.append(parent)
        if len(rows) > _MOST_NODES:
            raise ValueError(f"{path} must hold at most {_MOST_NODES} nodes")
    unknown = [p for p in parents if p >= 0 and p not in at]
    if unknown:
        raise ValueError(f"{path} must name parents that it holds, got {unknown[0]}")
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    edges = [(at[p], i) for i, p in enumerate(parents) if p >= 0]
    roots = [i for i, p in enumerate(parents) if p < 0]
    if len(roots) != 1:
        raise ValueError(f"{path} must hold one tree, with one node of parent -1, got {len(roots)}")
    return FoundLines(_chains(path, table[:, :3], table[:, 3], edges, roots[0]))


def read_graph(path: Path, tree: Any) -> FoundLines:
    """A JSON graph: nodes with an id, a position (or pos, xyz) and a radius (or r); edges (or links) between ids.

    tree : what the file holds

    Raises `ValueError` naming the file and what is wrong in it.
    """
    nodes = tree.get("nodes") if isinstance(tree, dict) else None
    edges = (tree.get("edges") or tree.get("links")) if isinstance(tree, dict) else None
    if not isinstance(nodes, list) or not isinstance(edges, list) or not nodes or not edges:
        raise ValueError(f"{path} must hold the lists 'nodes' and 'edges' (or 'links'), or be a Slicer markups file")
    if len(nodes) > _MOST_NODES or len(edges) > _MOST_NODES:
        raise ValueError(f"{path} must hold at most {_MOST_NODES} nodes and edges")
    at, points, r = _nodes(path, nodes)
    pairs = _edges(path, edges, at)
    unit, root = tree.get("unit", ""), tree.get("root", tree.get("inlet"))
    degree = np.bincount(np.array(pairs).ravel(), minlength=len(points))
    ends = np.flatnonzero(degree == 1)
    if isinstance(root, (str, int)) and root in at:
        begin = at[root]
    elif ends.size:
        begin = int(ends[np.nan_to_num(r[ends]).argmax()])
    else:
        raise ValueError(f"{path} must have an end, but every node has two edges or more")
    lines = _chains(path, points, r, pairs, begin)
    if np.isnan(r).all():
        for line in lines:
            line.radii = np.zeros(0)
    if unit and unit not in UNITS:
        raise ValueError(f"{path} unit must be one of {', '.join(UNITS)}, got {str(unit)[:20]!r}")
    axes = tree.get("coordinateSystem", tree.get("axes", ""))
    return FoundLines(lines, str(unit or ""), str(axes)[:8])


def _nodes(path: Path, nodes: list[Any]) -> tuple[dict[Any, int], np.ndarray, np.ndarray]:
    """The number of each id, the nodes' places (n, 3) and radii (n,), NaN where a node has none."""
    at: dict[Any, int] = {}
    points, radii = [], []
    for i, node in enumerate(nodes):
        if not isinstance(node, dict):
            raise ValueError(f"{path} nodes[{i}] must be an object, got {str(node)[:60]!r}")
        key = node.get("id", i)
        place: Any = next((node[k] for k in ("position", "pos", "xyz", "coords") if k in node), None)
        if place is None and all(k in node for k in "xyz"):
            place = [node[k] for k in "xyz"]
        radius: Any = node.get("radius", node.get("r", math.nan))
        if not isinstance(key, (str, int)) or not _numbers(place, 3) or not _numbers([radius], 1):
            raise ValueError(
                f"{path} nodes[{i}] must have an id, a position of three numbers and a radius, got {str(node)[:80]}"
            )
        if key in at:
            raise ValueError(f"{path} nodes[{i}] must have an id of its own, got {key!r} again")
        at[key] = i
        points.append([float(x) for x in place])
        radii.append(float(radius))
    return at, np.array(points), np.array(radii)


def _edges(path: Path, edges: list[Any], at: dict[Any, int]) -> list[tuple[int, int]]:
    """The numbers of the two nodes of each edge; edges from a node to itself are left out."""
    pairs = []
    for i, edge in enumerate(edges):
        ends = [edge.get("source"), edge.get("target")] if isinstance(edge, dict) else edge
        if (
            not isinstance(ends, list)
            or len(ends) != 2
            or any(isinstance(e, (list, dict)) or e not in at for e in ends)
        ):
            raise ValueError(f"{path} edges[{i}] must join two of the nodes' ids, got {str(edge)[:60]}")
        if at[ends[0]] != at[ends[1]]:
            pairs.append((at[ends[0]], at[ends[1]]))
    return pairs


def _numbers(value: Any, count: int) -> bool:
    if not isinstance(value, (list, tuple)) or len(value) != count:
        return False
    return all((isinstance(x, (int, float)) and not isinstance(x, bool) and abs(x) < 1e300) or x != x for x in value)


def _chains(
    path: Path, points: np.ndarray, radii: np.ndarray, edges: Iterable[tuple[int, int]], root: int
) -> list[TreeLine]:
    """Lines from forks to forks of a tree of nodes, each with its parent; the wider or first branch does not go on."""
    joined: dict[int, list[int]] = {}
    for a, b in edges:
        joined.setdefault(a, []).append(b)
        joined.setdefault(b, []).append(a)
    lines: list[TreeLine] = []
    seen = {root}
    starts: list[tuple[int, int, int | None]] = [(root, n, None) for n in joined.get(root, [])]
    if not starts:
        raise ValueError(f"{path} must have an edge at its root")
    if len(starts) > 1:  # the root lies inside the tree: the first line begins there, the others leave it
        starts = [starts[0]] + [(a, b, 0) for a, b, _ in starts[1:]]
    while starts:
        a, b, parent = starts.pop(0)
        if b in seen:
            raise ValueError(f"{path} must be a tree, but holds a circle through {points[b].tolist()}")
        chain = [a, b]
        seen.add(b)
        while True:
            ahead = [n for n in joined[chain[-1]] if n != chain[-2]]
            if len(ahead) != 1:
                break
            if ahead[0] in seen:
                raise ValueError(f"{path} must be a tree, but holds a circle through {points[ahead[0]].tolist()}")
            seen.add(ahead[0])
            chain.append(ahead[0])
        starts += [(chain[-1], n, len(lines)) for n in ahead]
        lines.append(TreeLine("", points[chain], radii[chain], parent))
    if len(seen) < len(joined):
        lost = next(n for n in joined if n not in seen)
        raise ValueError(f"{path} must hang together, but cannot reach {points[lost].tolist()} from its root")
    return lines
