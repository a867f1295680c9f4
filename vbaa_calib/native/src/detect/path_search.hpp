// The paths in a picture along which the evidence of a ribbon is largest, whichever way they wind.
#pragma once

#include <array>
#include <vector>

#include "arrays.hpp"

namespace vbaa::detect {

struct PathRules {
    double widths_per_px = 1.0;  // lengths along which evidence counts once, for a pixel of a path
    double enough = 2.5;         // log odds of such a length that count as full evidence
    double length_cost = 0.0;    // log odds against such a length
    double turn_cost = 0.0;      // log odds for a change of direction by two in a step, growing with its square
    double tolerance_px = 0.0;   // by which a path may miss the places where it has to begin or end
    double apart_px = 0.0;       // nearer than this, two paths' places are one
    double least = 0.0;          // evidence below which a path is none
    double bound = 0.0;          // cost, missing evidence and turns, at which a path is abandoned
    std::array<double, 2> slack = {1.0, 0.0};  // bound for further paths: factor on a path's cost, and constant
    double drop = 0.0;  // loss of evidence beyond which a path that may end anywhere is not followed
    int count = 0;      // number of paths
};

struct FoundPath {
    Array<double, 2> path_px;  // (N, 2) from the start
    double evidence = 0.0;     // less what turns cost
    double cost = 0.0;         // missing evidence and turns
};

// Paths by the evidence of ribbons down a picture and, in the transposed one, across it, both from `ribbon_evidence`;
// the best one first, each apart from those before it. From one of `starts` (N, 2) to one of `ends` (M, 2); without
// ends to where the evidence is largest; without starts from wherever there is much.
std::vector<FoundPath> best_paths(View<const float, 3> down, View<const float, 3> across, ConstMatrix starts,
                                  ConstMatrix ends, const PathRules& rules);

}  // namespace vbaa::detect
