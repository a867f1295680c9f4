// The antenna's possible paths against a reduced picture: how much every path looks like a ridge.
#pragma once

#include <cstdint>

#include "detect/picture.hpp"

namespace vbaa::detect {

// Normals along which ridges are searched: (u, v) steps 0 → right, → both, → down, → right and up.
constexpr int DIRECTIONS = 4;

// Table of the samples of paths in a picture that is reduced by a factor to a height and width, with its response
// pooled.
struct PathTable {
    int factor, pool, height, width;
    int reach = 0;  // of the flanks, reduced pixels to either side
    // (P, S) where the response of each sample stands among those of directions, rows and columns: that for the
    // direction nearest to the path's normal; beyond the picture, after the last. And (directions · rows, 2) the
    // columns of each row, from the first to before the last, in which there are any
    View<const std::int32_t, 2> index, spans;
    ConstVector
        weight;  // (P,) divisor of a path's sum: the number of its samples in the picture, at least LEAST_INSIDE of all

    int rows() const { return (height + pool - 1) / pool; }
    int columns() const { return (width + pool - 1) / pool; }
};

struct PathPlaces {
    Array<std::int32_t, 2> index, spans;
    Array<double, 1> weight;
};

// `PathTable.index`, `.spans` and `.weight` of paths (P, S, 2) px.
PathPlaces places(ConstCube paths_px, const PathTable& paths);

// (P,) of paths: the sum of their samples' responses over their weight. A line that is brighter, or darker, than both
// flanks responds, in the channel that shows it most; up to the texture's level not at all, and at a few times that,
// where a ridge is clear, no more: a brighter ridge must not make up for a detour.
Array<double, 1> path_scores(const Picture& picture, const PathTable& paths, bool brighter, bool darker);

// Indices of up to `count` of the paths (P, S, 2), P > 0, best first, that differ from the ones before them and have
// scores (P,) of at least `share` of the best. Two are alike where most of their points lie within `apart_px`.
std::vector<int> clearest_paths(ConstVector score, ConstCube paths_px, double apart_px, int count, double share);

// (K, 2) path along a line brighter (sign 1) or darker (−1) than both flanks, at most `reach_px` off the initial path;
// no points where the path has no two columns.
Array<double, 2> refine_path(const Picture& picture, ConstMatrix path_px, double width_px, double reach_px,
                             double sign);

}  // namespace vbaa::detect
