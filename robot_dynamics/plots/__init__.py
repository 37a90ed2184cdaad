"""Pictures in two dimensions: their style, and maps over poses of platforms."""
