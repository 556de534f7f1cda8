"""The cases, a module for each group; `veriray_validate.run.cases` imports them all."""
