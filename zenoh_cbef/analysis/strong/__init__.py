"""The strong yardstick: what one centre that has every range can reach, also where the extended filter is lost."""

from zenoh_cbef.analysis.strong.yardstick import Known, Seen, strong

__all__ = ["Known", "Seen", "strong"]
