"""Published parameter sets, each value with its unit and source; one file per source."""
