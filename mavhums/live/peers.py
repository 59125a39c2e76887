"""The peers that send for each vehicle over a link, and how many bytes each may receive.

The address of a datagram can be forged. So a peer receives data only about vehicles that it sends
for, never more bytes than it sent, and none after ten seconds of silence.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field
from typing import Final

__all__ = ["Peers"]

_PEERS: Final = 64
_HEARD_US: Final = 10_000_000
_CREDIT: Final = 1 << 16
_GROUND: Final = 250  # ground stations choose system ids from here up: 255, 252, 250


@dataclass(slots=True)
class _Peer:
    """``credit``: number of bytes it may receive; ``latest_us``: time of its last frame, by vehicle."""

    credit: int = 0
    latest_us: dict[int, int] = field(default_factory=dict)


class Peers:
    """Remembers at most 64 peers: those that sent most."""

    def __init__(self) -> None:
        self._peers: dict[Hashable, _Peer] = {}

    def __len__(self) -> int:
        return len(self._peers)

    def hear(self, sender: Hashable, vehicles: Iterable[int], size: int, time_us: int) -> None:
        """Note ``size`` bytes of accepted frames of these vehicles from a peer."""
        if sender not in self._peers and len(self._peers) >= 2 * _PEERS:
            self.forget(time_us)
        peer = self._peers.setdefault(sender, _Peer())
        peer.credit = min(peer.credit + size, _CREDIT)
        for vehicle in vehicles:
            peer.latest_us[vehicle] = time_us

    def forget(self, now_us: int) -> None:
        """Forget silent peers and, if there are too many, those that sent least."""
        since_us = now_us - _HEARD_US
        for peer in self._peers.values():
            peer.latest_us = {k: latest for k, latest in peer.latest_us.items() if latest >= since_us}
        kept = {sender: peer for sender, peer in self._peers.items() if peer.latest_us}
        if len(kept) > _PEERS:
            most = sorted(kept, key=lambda sender: kept[sender].credit, reverse=True)[:_PEERS]
            kept = {sender: kept[sender] for sender in most}
        self._peers = kept

    def speaking_for(self, vehicle: int, now_us: int) -> list[Hashable]:
        """Return the peers that recently sent for a vehicle."""
        since_us = now_us - _HEARD_US
        return [
            sender
            for sender, peer in self._peers.items()
            if peer.latest_us.get(vehicle, since_us - 1) >= since_us
        ]

    def vehicles(self, now_us: int) -> list[int]:
        """Return the vehicles that peers recently sent for; ground stations are none."""
        since_us = now_us - _HEARD_US
        heard = (peer.latest_us.items() for peer in self._peers.values())
        return sorted(
            {
                vehicle
                for each in heard
                for vehicle, latest in each
                if latest >= since_us and vehicle < _GROUND
            }
        )

    def afford(self, sender: Hashable, size: int) -> bool:
        """Return whether a peer may receive this many bytes, and count them."""
        peer = self._peers.get(sender)
        if peer is None or peer.credit < size:
            return False
        peer.credit -= size
        return True

    def contested(self, now_us: int) -> list[int]:
        """Return the vehicles for which more than one peer recently sent."""
        since_us = now_us - _HEARD_US
        claims = Counter(
            vehicle
            for peer in self._peers.values()
            for vehicle, latest in peer.latest_us.items()
            if latest >= since_us
        )
        return sorted(vehicle for vehicle, peers in claims.items() if peers > 1)
