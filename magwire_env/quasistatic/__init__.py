"""The quasi-static theory of the locked wire: force maps, best commands, certificates, placement and pools."""

from .certificate import Certificate, certificate, certify
from .forcemap import best_command, drive_at, force_map
from .placement import best_placement

__all__ = [
    "Certificate",
    "best_command",
    "best_placement",
    "certificate",
    "certify",
    "drive_at",
    "force_map",
]
