"""Sources of the platform's pose against each other: which of them disagrees."""

from .hypotheses import Fault, Suspect
from .monitor import Agreement, AgreementMonitor, AgreementNoise

__all__ = ["Agreement", "AgreementMonitor", "AgreementNoise", "Fault", "Suspect"]
