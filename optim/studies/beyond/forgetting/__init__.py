"""Study of forgetting: controllers that learn one environment after another, by method and by body."""
