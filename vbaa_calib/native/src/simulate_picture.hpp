// Pixels of the simulator's pictures: rays between pixel centres, the bench behind everything, the antenna's tube.
#pragma once

#include <cstdint>

#include "arrays.hpp"
#include "vectors.hpp"

namespace vbaa::simulate {

// x/z and y/z at pixels (N, 2), interpolated linearly in a map (height + 2, width + 2, 2) of the pixel centres with one
// pixel more on every side.
Array<double, 2> rays_between(ConstCube padded, ConstMatrix pixels);

// Where on a bench of so many texels the rays of such a map end: (height, width, 2), see picture.py.
Array<float, 3> bench_texels(ConstCube padded, const Rotation& R_world_camera, int texels, double reach);

// Pixels that a tube may touch, K of them.
struct TubePixels {
    Array<std::int64_t, 1> rows, columns, nearest;  // nearest of the tube's samples
    Array<double, 2> coverage, shade;               // (K, S) covered part and brightness of each sub-pixel
};
// curve: (N, 7) pixel, tangent, normal and half width of the tube's samples. inner: (S, 2) places of a pixel's
// sub-pixels, of which `divisions` lie side by side. asymmetry: how much brighter one flank is.
TubePixels tube_pixels(ConstMatrix curve, int width, int height, ConstMatrix inner, int divisions, double asymmetry);

}  // namespace vbaa::simulate
