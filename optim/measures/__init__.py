"""What is measured of searches and learners, as functions of arrays. Knows neither robots nor physics."""
