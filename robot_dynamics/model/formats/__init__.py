"""Description formats, a reader and a writer each: URDF, MDH tables in YAML, SYMORO+ .par."""
