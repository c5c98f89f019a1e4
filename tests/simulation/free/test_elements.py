"""Gradients and Hessians of the rod's energies against finite differences, in 16 random joints at once."""

import numpy as np
import pytest
from numba import njit

from magwire_env.simulation.free import elements
from magwire_env.simulation.free.vectors import load3, store3
from magwire_env.simulation.lanes import LANES, load, reciprocal, spread, sqrt, store

STEP = 1e-5


@njit
def _directed(e):
    inv = reciprocal(sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]))
    return (e[0] * inv, e[1] * inv, e[2] * inv), inv


@njit
def _put6(out, at, h):
    store(out, at, h[0]), store(out, at + LANES, h[1]), store(out, at + 2 * LANES, h[2])
    store(out, at + 3 * LANES, h[1]), store(out, at + 4 * LANES, h[3]), store(out, at + 5 * LANES, h[4])
    store(out, at + 6 * LANES, h[2]), store(out, at + 7 * LANES, h[4]), store(out, at + 8 * LANES, h[5])


@njit
def _put9(out, at, h):
    store3(out, at, (h[0], h[1], h[2]))
    store3(out, at + 3 * LANES, (h[3], h[4], h[5]))
    store3(out, at + 6 * LANES, (h[6], h[7], h[8]))


@njit
def bent(x, out):
    u, p = _directed(load3(x, 0))
    w, q = _directed(load3(x, 3 * LANES))
    energy, ge, gf, hee, hef, hff = elements.bent(spread(1.3), u, p, w, q, spread(1.0))
    store(out, 0, energy)
    store3(out, LANES, ge)
    store3(out, 4 * LANES, gf)
    _put6(out, 7 * LANES, hee)
    _put9(out, 16 * LANES, hef)
    _put6(out, 25 * LANES, hff)


@njit
def stretched(x, out):
    e = load3(x, 0)
    w, p = _directed(e)
    energy, tension, h = elements.stretched(spread(2.0), spread(0.7), reciprocal(p), w, p, spread(1.0))
    store(out, 0, energy)
    store3(out, LANES, (tension * w[0], tension * w[1], tension * w[2]))
    _put6(out, 4 * LANES, h)


@njit
def twisting(x, base, out):
    """x: e, f and spins; base: e, f and directors m, n there."""
    u0, _ = _directed(load3(base, 0))
    w0, _ = _directed(load3(base, 3 * LANES))
    u, p = _directed(load3(x, 0))
    w, q = _directed(load3(x, 3 * LANES))
    m = elements.turned(elements.transported(load3(base, 6 * LANES), u0, u), u, load(x, 6 * LANES))
    n = elements.turned(elements.transported(load3(base, 9 * LANES), w0, w), w, load(x, 7 * LANES))
    one = spread(1.0)
    energy, torque, half, hee, hef, hff = elements.twisted(spread(0.8), u, p, m, w, q, n, one)
    store(out, 0, energy)
    store(out, LANES, torque)
    store3(out, 2 * LANES, (p * torque * half[0], p * torque * half[1], p * torque * half[2]))
    store3(out, 5 * LANES, (q * torque * half[0], q * torque * half[1], q * torque * half[2]))
    _put6(out, 8 * LANES, hee)
    _put9(out, 17 * LANES, hef)
    _put6(out, 26 * LANES, hff)
    store3(out, 35 * LANES, (p * half[0], p * half[1], p * half[2]))
    store3(out, 38 * LANES, (q * half[0], q * half[1], q * half[2]))
    a, a1 = elements.natural(0.3, -0.2, u, m)
    b, b1 = elements.natural(0.3, -0.2, w, n)
    s, ge, gf, ta, tb, hee, hef, hff, hea, heb, hfa, hfb, haa, hbb = elements.precurved(
        spread(1.1), u, p, w, q, a, b, a1, b1, one
    )
    o = 41 * LANES
    store(out, o, s)
    store3(out, o + LANES, ge)
    store3(out, o + 4 * LANES, gf)
    store(out, o + 7 * LANES, ta)
    store(out, o + 8 * LANES, tb)
    _put6(out, o + 9 * LANES, hee)
    _put9(out, o + 18 * LANES, hef)
    _put6(out, o + 27 * LANES, hff)
    store3(out, o + 36 * LANES, hea)
    store3(out, o + 39 * LANES, heb)
    store3(out, o + 42 * LANES, hfa)
    store3(out, o + 45 * LANES, hfb)
    store(out, o + 48 * LANES, haa)
    store(out, o + 49 * LANES, hbb)


def call(kernel, x, *more):
    out = np.zeros(100 * LANES)
    kernel(np.ascontiguousarray(x).ravel(), *[np.ascontiguousarray(m).ravel() for m in more], out)
    return out.reshape(-1, LANES)


def differences(kernel, x, rows, *more):
    """d(rows)/dx by central differences, (rows, len(x), LANES)."""
    columns = []
    for k in range(len(x)):
        plus, minus = x.copy(), x.copy()
        plus[k] += STEP
        minus[k] -= STEP
        columns.append((call(kernel, plus, *more)[rows] - call(kernel, minus, *more)[rows]) / (2 * STEP))
    return np.stack(columns, axis=1)


def close(a, b):
    np.testing.assert_allclose(a, b, atol=2e-8 * max(1.0, np.abs(b).max()))


def segments(seed, size=0.8):
    rng = np.random.default_rng(seed)
    return np.concatenate([[1.0, 0, 0], [1.0, 0, 0]])[:, None] + size * rng.uniform(-1, 1, (6, LANES))


def test_bending():
    x = segments(0)
    out = call(bent, x)
    close(out[1:7], differences(bent, x, slice(0, 1))[0])
    d = differences(bent, x, slice(1, 7))
    close(out[7:16].reshape(3, 3, -1), d[:3, :3])
    close(out[16:25].reshape(3, 3, -1), d[:3, 3:])
    close(out[25:34].reshape(3, 3, -1), d[3:, 3:])


def test_stretching():
    x = segments(1)[:3]
    out = call(stretched, x)
    close(out[1:4], differences(stretched, x, slice(0, 1))[0])
    close(out[4:13].reshape(3, 3, -1), differences(stretched, x, slice(1, 4)))


def frames(x, rng):
    rows = []
    for k in (0, 3):
        t = x[k : k + 3] / np.linalg.norm(x[k : k + 3], axis=0)
        m = rng.normal(size=(3, LANES))
        m -= t * (m * t).sum(axis=0)
        rows.append(m / np.linalg.norm(m, axis=0))
    return np.concatenate(rows)


def twist_case(seed):
    x = np.concatenate([segments(seed, 0.5), np.zeros((2, LANES))])
    base = np.concatenate([x[:6], frames(x, np.random.default_rng(seed + 1))])
    return x, base


@pytest.mark.parametrize("seed", [2, 3])
def test_twist(seed):
    x, base = twist_case(seed)
    out = call(twisting, x, base)
    d = differences(twisting, x, slice(0, 1), base)[0]
    close(out[2:8], d[:6])
    close(-out[1], d[6])
    close(out[1], d[7])
    # second derivatives: k dτ dτᵀ + torque d²τ; along e or f alone, directors carried anew from the base
    gradient = differences(twisting, x, slice(2, 8), base)
    t, k = out[35:41], 0.8
    whole = np.concatenate(
        [
            np.concatenate([out[8:17].reshape(3, 3, -1), out[17:26].reshape(3, 3, -1)], axis=1),
            np.concatenate([out[17:26].reshape(3, 3, -1).transpose(1, 0, 2), out[26:35].reshape(3, 3, -1)], axis=1),
        ]
    )
    whole += k * t[:, None] * t[None]
    symmetric = 0.5 * (gradient[:, :6] + gradient[:, :6].transpose(1, 0, 2))
    close(whole, symmetric)
    close(-k * t, gradient[:, 6])
    close(k * t, gradient[:, 7])


@pytest.mark.parametrize("seed", [4, 5])
def test_natural_curvature(seed):
    x, base = twist_case(seed)
    o = 41
    out = call(twisting, x, base)[o:]
    d = differences(twisting, x, slice(o, o + 1), base)[0]
    close(out[1:9], d)
    g = differences(twisting, x, slice(o + 1, o + 9), base)
    whole = np.concatenate(
        [
            np.concatenate([out[9:18].reshape(3, 3, -1), out[18:27].reshape(3, 3, -1)], axis=1),
            np.concatenate([out[18:27].reshape(3, 3, -1).transpose(1, 0, 2), out[27:36].reshape(3, 3, -1)], axis=1),
        ]
    )
    close(whole, 0.5 * (g[:6, :6] + g[:6, :6].transpose(1, 0, 2)))
    close(out[36:39], g[:3, 6])
    close(out[39:42], g[:3, 7])
    close(out[42:45], g[3:6, 6])
    close(out[45:48], g[3:6, 7])
    close(out[48], g[6, 6])
    close(out[49], g[7, 7])
    assert np.abs(g[6, 7]).max() < 1e-8
