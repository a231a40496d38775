"""Files of measurement computers: ASAM MDF (`asammdf`) and TDMS of LabVIEW (`nptdms`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import CommandError, join_names
from ..base.extras import require_extra
from ..base.wording import matches_pattern

MEASUREMENT_ENDINGS = (".mf4", ".mdf", ".tdms")
"""File extensions of measurement files."""

TIME = "time"
"""Name of the column of times that is not a channel."""


@dataclass(frozen=True)
class Channel:
    """A channel of a measurement file.

    Attributes:
        name: Its name.
        unit: The name of its unit, None without one.
        read: Returns its values, and its times in s.
    """

    name: str
    unit: str | None
    read: Callable[[], tuple[np.ndarray, np.ndarray | None]]


@dataclass(frozen=True)
class ChannelGroup:
    """Channels that were sampled at the same times. `name` is the name of the group."""

    name: str
    channels: Sequence[Channel]


def is_measurement_file(content: bytes) -> bool:
    """Return whether a file is MDF or TDMS, from its first bytes."""
    return content.startswith((b"MDF ", b"UnFinMF ", b"TDSm"))


def read_groups(file: Path, content: bytes, label: str) -> list[ChannelGroup]:
    """Return the groups of a measurement file; of an MDF file those that were sampled over time.

    Args:
        file: The file.
        content: Its first bytes.
        label: What error messages call it.

    Raises:
        CommandError: If the package for it is not installed.
    """
    read, extra = (_read_tdms, "tdms") if content.startswith(b"TDSm") else (_read_mdf, "mdf")
    require_extra(extra, label)
    return read(file)


def choose_group(groups: Sequence[ChannelGroup], names: Sequence[str], label: str) -> ChannelGroup:
    """Return the group that has channels of all these names; a single group in any case.

    Args:
        groups: The groups.
        names: Names of channels, or patterns. Names that no group has are ignored.
        label: What error messages call the file.

    Raises:
        CommandError: If no group or several groups have them.
    """
    if len(groups) == 1:
        return groups[0]
    if not groups:
        raise CommandError(f"{label} has no channels with numbers.")
    present = [a for a in names if any(_has_channel(group, a) for group in groups)]
    matches = [group for group in groups if present and all(_has_channel(group, a) for a in present)]
    if len(matches) == 1:
        return matches[0]
    listed = join_names([f"'{g.name}'" for g in groups[:8]])
    if not present:
        raise CommandError(
            f"{label} has channels sampled at different times, in the groups {listed}; name the channels to "
            "use."
        )
    if not matches:
        raise CommandError(
            f"{label} has {join_names(present)} in different groups, sampled at different times; use one "
            "input for each group."
        )
    raise CommandError(
        f"{label} has {join_names(present)} in the groups {join_names([g.name for g in matches])}; the names "
        "of channels must be unique."
    )


def _has_channel(group: ChannelGroup, name: str) -> bool:
    return any(c.name == name or matches_pattern(c.name, name) for c in group.channels)


def _read_mdf(file: Path) -> list[ChannelGroup]:
    """Return the groups sampled over time, each with a channel of its times; the file stays open."""
    from asammdf import MDF

    groups = []
    mdf = MDF(file)  # the readers keep it open: opening it reads the descriptions of all channels

    def read(group: int, index: int) -> tuple[np.ndarray, np.ndarray | None]:
        signal = mdf.get(group=group, index=index)
        return signal.samples, signal.timestamps

    for number, group in enumerate(mdf.groups):
        master = mdf.masters_db.get(number)
        if master is None or getattr(group.channels[master], "sync_type", 1) not in (0, 1):
            continue  # not sampled over time, but over an angle or a distance
        channels = [Channel(TIME, "s", lambda number=number: (mdf.get_master(number), None))]
        for index, c in enumerate(group.channels):
            if index != master:
                unit = str(c.unit or getattr(c.conversion, "unit", None) or "").strip()
                channels.append(Channel(c.name, unit or None, partial(read, number, index)))
        name = str(getattr(group.channel_group, "acq_name", "") or f"group {number + 1}")
        groups.append(ChannelGroup(name, channels))
    return groups


def _read_tdms(file: Path) -> list[ChannelGroup]:
    """Return the groups that have channels; one of times comes first where a channel has a time track."""
    from nptdms import TdmsFile

    def read(channel: Any) -> tuple[np.ndarray, np.ndarray | None]:
        return channel[:], channel.time_track() if "wf_increment" in channel.properties else None

    groups = []
    for group in TdmsFile.read(file).groups():
        channels = []
        for c in group.channels():
            units = (c.properties.get(key) for key in ("unit_string", "NI_UnitDescription"))
            unit = str(next(filter(None, units), "")).strip()
            channels.append(Channel(c.name, unit or None, partial(read, c)))
        timed = next((c for c in group.channels() if "wf_increment" in c.properties), None)
        if timed is not None and not any(c.name == TIME for c in channels):
            channels.insert(0, Channel(TIME, "s", lambda timed=timed: (timed.time_track(), None)))
        if channels:
            groups.append(ChannelGroup(group.name, channels))
    return groups
