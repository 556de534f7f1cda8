"""The cases, a module for each group; `veriray.validate.run.cases` imports them all."""
