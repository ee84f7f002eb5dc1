"""Products that stand on the package, each in a folder that may be deleted: the core imports none of them."""
