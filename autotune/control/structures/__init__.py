"""Control structures beside each other on the twin of an axis: the catalogue of section 6.3.8."""
