"""The commands of `veriray`, a module each: `add` gives the parser its arguments and handler."""
