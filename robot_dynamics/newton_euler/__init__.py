"""The recursive Newton-Euler algorithms, over generic scalars and leading batch axes, without ROS.

Source throughout: W. Khalil, "Dynamic Modeling of Robots using Recursive Newton-Euler Techniques".
Accelerations in here are classical ones of the frames' origins, with gravity taken off: a base at rest accelerates
at -g.
Wrenches f_e in here are what a link does to its environment, as in the paper.
"""
