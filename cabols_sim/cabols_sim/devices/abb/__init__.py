"""The simulated ABB controller: RAPID program, EGM and Robot Web Services."""
