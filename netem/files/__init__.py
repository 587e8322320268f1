"""How settings are read from files: tables, TOML, CSV, and what is wrong with them."""
