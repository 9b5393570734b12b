"""Client of an ABB controller: EGM feedback, RWS, the stored configurations."""
