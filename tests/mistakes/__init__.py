"""Mistakes as users make them: each is answered by its culprit and by a remedy, and the remedy is followed."""
