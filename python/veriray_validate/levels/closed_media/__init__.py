"""Media against closed forms and radiative transfer."""
