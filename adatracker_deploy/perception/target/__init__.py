"""Target selection and re-identification: the target is chosen once and never silently swapped."""
