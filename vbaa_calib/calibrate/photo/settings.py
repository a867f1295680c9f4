"""What a rod in a photograph is supposed to be like, and where a finder of rods draws its lines."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RodSettings:
    """Tunable numbers of the search for a rod; grey levels are of 255, evidence is in natural log odds."""

    most_megapixels: float = 1.0
    narrowest_px: float = 2.4
    widest_px: float = 140.0
    width_step: float = 1.5
    level_width_px: float = 3.5
    shading: tuple[float, float] = (4.0, 2.5)
    least_noise: float = 0.7
    spread: float = 50.0
    flat: float = 0.7
    edge: float = 0.25
    correlation_share: float = 0.015
    chance: float = 0.05
    gap: float = -2.5
    turn_cost: float = 0.4
    click_share: float = 0.012
    least_evidence: float = 12.0
    candidates: int = 6
    detour: float = 1.5
    least_aspect: float = 6.0
    least_edges: float = 0.5
    most_turn: float = 2.3
    longest_gap: float = 0.15
    least_evidence_alone: float = 60.0
    least_evidence_known: float = 15.0
    rival_share: float = 0.5
    rival_share_known: float = 0.6
    least_holder_lead: float = 6.0
    least_turn: float = 0.12
    straight_cost: float = 15.0
    no_tip_cost: float = 40.0
    least_mean: float = 1.8
    least_mean_alone: float = 2.6
    shadow_cost: float = 0.5
    least_growth: float = 6.0
    turned_cost: float = 5.0
    winding_cost: float = 2.0
    good_mean: float = 2.85
