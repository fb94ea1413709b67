"""Tools for studies: results kept on disk, searches side by side, trials, tables, figures."""
