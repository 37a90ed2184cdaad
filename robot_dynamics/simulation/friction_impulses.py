"""Friction of joints that truly stick, and that damps what hardly has inertia: the impulses of one step.

Dry friction takes of the velocities v* that all else leaves what it can: v = v* + W p with |p| ≤ Fs h, where p is the
opposite of the motion that is left, or whatever holds the joint at rest. A force Fs sign(q̇) in explicit steps would
chatter instead. Viscous friction that is too strong for explicit steps is here too, p = -Fv h v. Source: J. J. Moreau,
Unilateral contact and dry friction in finite freedom dynamics, 1988: time stepping.
"""

import numpy as np

MAX_SWEEPS = 200
CONVERGENCE_TOLERANCE = 1e-12  # part of the largest impulse that may still change
STIFF_DAMPING_RATIO = 0.3  # h Fv / inertia of a joint beyond which its viscous friction belongs here


def friction_impulses(W, velocities, dry, viscous):
    """Impulses p (k,) [N m s or N s] of friction.

    W: (k, k) what velocities (k,) change by for unit impulses; dry, viscous: (k,) Fs h and Fv h. Gauss-Seidel with
    projection; where every joint goes on sliding the first guess is the answer.
    """
    damped = np.linalg.solve(np.eye(len(W)) + W * viscous, np.column_stack([velocities, W]))
    left, W_damped = damped[:, 0], damped[:, 1:]
    impulses = _dry_impulses(W_damped, left, dry) if dry.any() else np.zeros(len(dry))
    return impulses - viscous * (left + W_damped @ impulses)


def _dry_impulses(W, velocities, bounds):
    impulses = -bounds * np.sign(velocities)
    if ((velocities + W @ impulses) * velocities >= 0).all():
        return impulses
    for _ in range(MAX_SWEEPS):
        before = impulses.copy()
        for k in range(len(bounds)):
            wanted = impulses[k] - (velocities[k] + W[k] @ impulses) / W[k, k]
            impulses[k] = min(max(wanted, -bounds[k]), bounds[k])
        if np.abs(impulses - before).max() <= CONVERGENCE_TOLERANCE * bounds.max():
            break
    return impulses
