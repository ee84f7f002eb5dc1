"""Finding Ipopt, running it in process, and solving complementarity problems by continuation."""
