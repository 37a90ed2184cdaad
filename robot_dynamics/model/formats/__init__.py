"""Texts that describe robots: URDF, MDH tables in YAML, SYMORO+ .par; a reader and a writer of each."""
