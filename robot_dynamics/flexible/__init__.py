"""Elastodynamics: robots whose links bend; their mass and stiffness, natural frequencies and motion."""
