"""What studies share: parts kept on disk, searches side by side, trials, tables, figures."""
