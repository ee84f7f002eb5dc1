"""What is taken for zero: one tolerance wherever nothing but rounding may make a difference, and one of solvers."""

# Relative to the size of what is compared: far above what rounding leaves of it, and far below what anybody states.
NEGLIGIBLE = 1e-9
# The same for what a few operations have made.
ROUNDING = 1e-12
# What solvers and linear programs leave of zero: of rows, of sides of pairs, of distances from bounds, in their sizes.
MET = 1e-6
