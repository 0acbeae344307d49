"""The first-generation Lytro on its own Wi-Fi: protocol and client (lytro_f01.md, section A)."""
