"""Elastodynamics: mass and stiffness, natural frequencies and dynamics of robots with flexible links."""
