// From frames to their fits: which minimum, which rung of the ladder, and what else would explain each frame.
#pragma once

#include "solver/frames.hpp"
#include "solver/numbers.hpp"

namespace vbaa::solver {

// The highest rung's answer, and with it the lowest rung that would have been good enough.
constexpr int AUTO = -1;

// The rig in four forms: with the axes that matter in frames of usual information, with all axes, with the first few
// of them, for rough minima, and as exactly known.
struct Rigs {
    const Rig &usual, &complete, &rough, &exact;
};

// What is asked for: frames from `begin` to `end`, on a rung or AUTO. warm: (B, 4) unknowns near the truth where
// finite, or none. pieces_m: (PIECES,) arc lengths, if motion is tested, else none. minima_only: uncertainties to first
// order only.
struct Demand {
    int begin, end, rung;
    ConstMatrix warm;
    ConstVector pieces_m;
    bool minima_only;
};

// Fits these, each by itself, into their `numbers`. Of a frame with too few points only their number is written.
template <class Measured>
void solve_frames(const Rigs& rigs, const Measured& frames, const Demand& demand, View<Numbers, 1> numbers);

// Rough minima (B, 4) on a low rung, and the antennas' nodes there (B, M, 3), antenna frame.
void rough_frames(const Rig& rig, const Frames& frames, Matrix unknowns, Cube points_m);

}  // namespace vbaa::solver
