"""Problems with known answers, and models that are wrong in a known way."""
