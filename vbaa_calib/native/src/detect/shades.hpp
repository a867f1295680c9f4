// The blurred brightness of a round antenna across its silhouette: a Fourier series in the angle of its surface, in
// which any light on a diffuse surface has two harmonics (Ramamoorthi and Hanrahan 2001); and of the background on
// either side.
#pragma once

#include "detect/line_shape.hpp"
#include "lanes.hpp"

namespace vbaa::detect {

// Mean over the silhouette; sine and cosine of the surface's angle, of twice it, and of three times it, of mean square
// one, the cosines less their mean.
constexpr int HARMONICS = 3, SHADES = 2 * HARMONICS + 1;
// The background on the left (against the normal) and on the right, then the shades except their mean, which is one
// less both sides.
constexpr int SIDES = 2, FUNCTIONS = SIDES + SHADES - 1;
constexpr int shade_column(int k) { return SIDES + k - 1; }  // k > 0
static_assert(FUNCTIONS <= LANES);
// The functions, their derivatives by the distance, px, and by the logarithms of the width and of the blur.
enum ShadeKind { VALUE, BY_DISTANCE, BY_WIDTH, BY_BLUR, KINDS };
constexpr int SHADE_COLUMNS = KINDS * LANES;  // of each kind, in whole lanes

// (2 · reach · PER_PX + 1, SHADE_COLUMNS) of a silhouette of this width seen through this blur, at distances from its
// centre.
Table shade_table(double width_px, double blur_px, int reach_px);

}  // namespace vbaa::detect
