"""Complementarity problems as numbers: branches, stationarity, and the certificate by linear programs."""
