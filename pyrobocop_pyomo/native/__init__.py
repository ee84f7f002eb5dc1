"""C parts of this package: compiled when it is installed, found again, loaded."""
