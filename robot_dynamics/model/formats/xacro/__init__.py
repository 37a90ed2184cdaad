"""xacro: macros and expressions that expand to a URDF, by the package xacro."""
