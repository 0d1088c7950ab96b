"""Parts of a braked vehicle that any plant is made of, each with parameters, state and law of its own."""
