"""Ground that everything may use: checks of input, atomic files, folders of results, safe XML."""
