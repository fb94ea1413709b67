"""Helpers that every package may use: checks of input, atomic files, array types, registries, options, safe XML."""
