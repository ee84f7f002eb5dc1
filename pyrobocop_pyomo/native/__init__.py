"""C parts of this package: compiled once on each machine, found again, loaded."""
