// The paths down a picture along which the evidence is largest, turning included.
#pragma once

#include <vector>

#include "arrays.hpp"

namespace vbaa::detect {

struct PathRules {
    double widths_per_step = 1.0;  // length of a step straight down, in widths: evidence is counted once a width
    double turn_cost = 0.0;        // log odds for a change of direction by one, growing with its square
    double tolerance_px = 0.0;     // by which a path may miss the places where it has to begin or end
    double apart_px = 0.0;         // nearer than this, two paths' places are one
    double least = 0.0;            // evidence below which a path is none
    int most = 0;                  // number of paths
};

struct FoundPath {
    Array<double, 2> path_px;  // (N, 2) downwards
    double evidence = 0.0;
};

// Paths by evidence (rows, directions, columns) of `ribbon_evidence`, the best one first, each apart from those before
// it over half of its length. Where there are `starts` (N, 2) or `ends` (M, 2), a path begins or ends near one of them.
std::vector<FoundPath> best_paths(View<const float, 3> evidence, ConstMatrix starts, ConstMatrix ends,
                                  const PathRules& rules);

}  // namespace vbaa::detect
