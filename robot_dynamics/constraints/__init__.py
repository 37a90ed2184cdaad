"""Constraints between joints: mimic relations and closed loops.

Three ideas, one after the other:

- `topology`: which joints are independent and which depend on them; found once for a robot. `mobility` finds the
  dependent joints.
- `state`: how all joints move with the independent ones at positions q that close the loops; forces and wrenches of the
  loops. `mixed_dynamics` and `charted_regressor` are the equations of motion of such a state.
- `closure_solver`: positions that close the loops. It uses `newton_iteration` (Newton's method), `branch_tracker`
  (continuation along a branch) and `assembly_modes` (seeds and assembly modes). `manifold_walk` walks over all closed
  positions at random.

Common to them: `loop_equations`, `least_squares`, and `attitude_charts` for the attitudes of platforms.
"""
