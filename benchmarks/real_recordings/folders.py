"""Folders of recordings that the benchmarks read."""

from pathlib import Path


def find_recordings(folder: Path) -> list[Path]:
    """CSV files, bags and folders of bags in a folder; the folder itself if it is one recording."""
    tables = sorted(folder.glob("*.csv"))
    bags = sorted({path.parent for path in folder.glob("*/metadata.yaml")})
    return [*tables, *bags] or [folder]
