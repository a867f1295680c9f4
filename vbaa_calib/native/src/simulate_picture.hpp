// Pixels of the simulator's pictures: rays between pixel centres, the bench behind everything, the antenna's tube.
#pragma once

#include <cstdint>
#include <vector>

#include "arrays.hpp"
#include "vectors.hpp"

namespace vbaa::simulate {

using ConstPicture = View<const float, 2>;
using ConstRays = View<const float, 3>;

// x/z and y/z at a pixel, interpolated linearly in a map (height + 2, width + 2, 2) of the pixel centres with one pixel
// more on every side; those at pixels (N, 2).
std::array<double, 2> ray_between(ConstRays padded, double u, double v);
Array<double, 2> rays_between(ConstRays padded, ConstMatrix pixels);

// (height, width) brightness where the rays of such a map end on a bench (T, T), see picture.py.
Array<float, 2> surroundings(ConstRays padded, const Rotation& R_world_camera, ConstPicture bench, double reach);

// Pixels [left, left + columns) × [top, top + rows) of a picture, each of so many sub-pixels along either axis. A row
// of sub-pixels has the first one of all its pixels, then their second, and so on.
struct Window {
    int left, top, columns, rows, factor;
};

// Brightness of ink and paper in some light; the rows of a window's pixels in which there may be some.
struct Print {
    double ink, paper;
    int begin, end;
};
// (2, rows·factor, factor·columns) brightness and presence of a sheet where the rays of such a map meet it. blocks:
// (R + 3, C + 3) of each two by two of its texels, from the second beyond it on, which ones are paper: 1 the first, 2
// the next in its row, 4 and 8 those below. texel_from_ray: (3, 3), of homogeneous coordinates; what lies behind the
// camera has a negative last one.
Array<float, 3> sheet_pixels(ConstRays padded, const Window& window, const Rotation& texel_from_ray,
                             View<const std::uint32_t, 2> blocks, const Print& print);

// (rows, columns) change of a canvas' blurred picture by a patch of sub-pixels in front of it: brightness (rows·factor,
// factor·columns), weighted with the part that it covers, and that part.
Array<float, 2> blurred_change(ConstPicture canvas, ConstPicture brightness, ConstPicture covered, const Window& window,
                               double sigma_px);

// (H, W) grey levels with shot noise and read noise, rounded.
Array<std::uint8_t, 2> digitised(ConstPicture grey, double electrons_per_grey, double read_noise, std::uint32_t seed);

// Values and slopes (M, D) of the cubic spline through points (N, D) at rising places (N,), N ≥ 4; its third derivative
// is the same on both sides of the second place and of the last but one.
std::array<Array<double, 2>, 2> spline(ConstVector places, ConstMatrix points, ConstVector at);

// What a stretch of a tube shows of itself in a picture, with room around it: left and top pixel, brightness and
// covered part of its sub-pixels (2, rows·factor, factor·columns); of those that it covers their place among all (N,),
// and their pixels and depths (N, 3).
struct TubePart {
    int left, top;
    Array<float, 3> fine;
    Array<int, 1> covered;
    Array<double, 2> seen;
};
// curve: (N, 9) pixel, tangent, normal, half width, light and depth of the tube's samples. Each pixel belongs to one
// stretch. asymmetry: how much brighter one flank is.
std::vector<TubePart> tube_parts(ConstMatrix curve, int width, int height, int room, int factor, double asymmetry);

}  // namespace vbaa::simulate
