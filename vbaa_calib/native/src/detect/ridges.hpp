// The antenna's possible paths against a reduced picture: how much every path looks like a ridge.
#pragma once

#include <cstdint>

#include "arrays.hpp"

namespace vbaa::detect {

using Bytes = View<const std::uint8_t, 1>;
using BytePicture = View<const std::uint8_t, 2>;

// Normals along which ridges are searched: (u, v) steps 0 → right, → both, → down, → right and up.
constexpr int DIRECTIONS = 4;

// How a picture is reduced: by a factor, its response pooled, to a number of rows and columns.
struct Reduction {
    int factor, pool, rows, columns;
};

// (P, S) where the response of each sample of paths (P, S, 2) px stands in `ridge_responses`: that for the direction
// nearest to the path's normal; beyond the picture, the last.
Array<std::int32_t, 2> places(ConstCube paths_px, const Reduction& reduction);

// (4 · rows · columns + 1,) ridge response for the four directions, pooled over `pool` pixels, flat; the last is zero.
// The line is brighter than both flanks `reach` pixels away, with a `sign` of −1 darker.
Array<std::uint8_t, 1> ridge_responses(BytePicture small, int reach, int pool, int sign);

// (P,) of paths with samples at `index` (P, S) in flat responses: their sum over `weight` (P,). A response is
// zero up to the texture's level and saturates at a few times that, where a ridge is clear: a brighter ridge must not
// make up for a detour.
Array<double, 1> scores(Bytes flat, View<const std::int32_t, 2> index, ConstVector weight);

// Up to so many of the paths (P, S, 2), P > 0, best first, that differ from the ones before them; their scores (P,) at
// least this share of the best. Two are alike where most of their points lie within `apart_px`.
std::vector<int> clearest_paths(ConstVector score, ConstCube paths_px, double apart_px, int count, double share);

}  // namespace vbaa::detect
