"""What is measured of bodies, controllers and searches. Knows neither robots nor physics."""
