"""Recursive Newton-Euler algorithms of trees, over generic scalars and leading batch axes.

Source throughout: W. Khalil, "Dynamic Modeling of Robots using Recursive Newton-Euler Techniques".

Conventions of this package:

- Accelerations are classical ones of the frames' origins, with gravity subtracted: a base at rest accelerates at -g.
- Wrenches f_e are those that a link exerts on its environment, as in the paper.
- Lists indexed by link number start with the base, link 0. Joint j moves link j.
"""
