"""Losses of a log: the parts that could not be read."""

from __future__ import annotations

from mavhums.core.models import Contract

__all__ = ["Losses", "Region", "SequenceLoss"]


class Region(Contract):
    """Damaged bytes between two frames: where they begin in the log, and how many they are."""

    offset: int
    size: int


class SequenceLoss(Contract):
    """What the sequence numbers of one sender say: frames that never reached the log.

    ``missing`` counts modulo 256 where a link was silent for long, so it is a lower bound.
    """

    system: int
    component: int
    frames: int
    missing: int
    gaps: int
    reordered: int
    duplicated: int


class Losses(Contract):
    """What could not be read, and what was odd.

    ``regions`` lists the first hundred of ``damaged_regions``. ``padded_frames`` had their zeros
    trimmed after the CRC was computed and were accepted with the zeros put back; at most
    ``padded_false_bound`` of them are expected to be accepted by chance. ``line_ends_restored``
    counts the carriage returns that a conversion to text had put in. Where only frames signed with a
    key are read, those without a signature, with a wrong one and with an old one were left out.
    ``logger_dropped`` counts what an on-board logger says that it could not write: records, or pauses
    where the format counts those. Four counts by message, of all vehicles: ``late_samples`` came after
    their second was settled or behind their own stream, ``same_time_samples`` have the time of an earlier
    one, ``broken_stamps`` a time that no clock of their sender explains, and ``copies`` had arrived before,
    as over several routes.
    """

    bytes_skipped: int = 0
    damaged_regions: int = 0
    bad_crc_frames: int = 0
    unknown_frames: int = 0
    implausible_times: int = 0
    cut_end_bytes: int = 0
    regions: tuple[Region, ...] = ()
    bad_crc_by_message: dict[str, int] = {}
    padded_frames: int = 0
    padded_false_bound: float = 0.0
    trailing_zeros: int = 0
    line_ends_restored: int = 0
    time_jumps: int = 0
    time_rewinds: int = 0
    sequence: tuple[SequenceLoss, ...] = ()
    unsigned_frames: int = 0
    bad_signatures: int = 0
    replayed_frames: int = 0
    logger_dropped: int = 0
    late_samples: dict[str, int] = {}
    same_time_samples: dict[str, int] = {}
    broken_stamps: dict[str, int] = {}
    copies: dict[str, int] = {}

    @property
    def any(self) -> bool:
        """Whether anything that the log held is gone or in doubt.

        Frames of a foreign dialect and frames that never reached the log are not, nor is a last frame that
        was not finished: so ends every log that ends with the power.
        """
        return bool(
            self.bytes_skipped
            or self.bad_crc_frames
            or self.implausible_times
            or self.padded_frames
            or self.bad_signatures
        )
