"""Where work is done: engines in this process, in others, on clusters; for teams and for studies."""
