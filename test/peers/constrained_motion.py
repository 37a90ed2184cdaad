"""Newton's law under linear constraints on accelerations, with multipliers: M x = f + Cᵀλ, C x = b."""

from typing import NamedTuple

import numpy as np

RANK = 1e-8  # singular values of C below this part of the largest one count as zero
REFINEMENTS = 3


class Constrained(NamedTuple):
    """x: (n,) accelerations; multipliers: λ (m,), those of least norm; residual: the largest entry of
    C x − b; free_multipliers: (m, m − rank), orthonormal columns, by which λ may change without a change of x."""

    x: np.ndarray
    multipliers: np.ndarray
    residual: float
    free_multipliers: np.ndarray


def constrained_motion(M, f, C, b):
    """Solve for x and λ; constraints may be redundant, and M singular where the constraints remove its null space.

    M: (n, n) symmetric; f: (n,); C: (m, n); b: (m,). The null-space method: x = x_C + N y with C N = 0, so that
    NᵀM N y = Nᵀ(f − M x_C), and then Cᵀλ = M x − f. Residuals are summed in long double and solved for again.
    Source: Benzi, Golub, Liesen, Numerical solution of saddle point problems (2005), section 6.
    """
    U, s, Vt = np.linalg.svd(C)
    rank = int(np.sum(s > RANK * s.max(initial=0)))
    across, along, N = U[:, :rank], Vt[:rank].T, Vt[rank:].T
    inner = N.T @ M @ N

    def solve_once(f, b):
        x = along @ (across.T @ b / s[:rank])
        x = x + N @ np.linalg.solve(inner, N.T @ (f - M @ x))
        return x, across @ (along.T @ (M @ x - f) / s[:rank])

    exact_M, exact_C = M.astype(np.longdouble), C.astype(np.longdouble)
    x, multipliers = solve_once(f, b)
    for _ in range(REFINEMENTS):
        missing_force = f - (exact_M @ x - exact_C.T @ multipliers)
        missing_acceleration = b - exact_C @ x
        more_x, more_multipliers = solve_once(missing_force.astype(float), missing_acceleration.astype(float))
        x, multipliers = x + more_x, multipliers + more_multipliers
    return Constrained(x, multipliers, np.abs(C @ x - b).max(initial=0), U[:, rank:])
