"""The user's rules, called once: templates that are evaluated wherever the rule would be."""
