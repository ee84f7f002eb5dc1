"""Teams: agents with models of their own that agree on shared quantities, by consensus ADMM."""
