// Covariances of a board's corners from the picture's noise, see vbaa_calib/detect/board/covariance.py.
#pragma once

#include <cstdint>

#include "arrays.hpp"

namespace vbaa::detect {

// How noise is measured, and when a window shows a corner.
struct CornerNoise {
    double smoothing_px;  // σ of the smoothed picture
    double least;         // variance of a pixel
    double flat;          // of the contrast from black or white, within which a pixel is flat
    double flat_kept;     // share of the flat pixels that is used
    double trimming;      // variance of normal numbers over that of this share of them, the smallest
    int flat_pixels;      // fewest flat pixels
    int largest_sample;   // most windows in which noise is measured
    double least_fixed;   // determinant of M over its trace squared, from which a window shows a corner
    double least_kept;    // share of M that J is assumed to keep
};

// (N, 2, 2) px² of corners (N, 2) px that were refined in a smoothed picture (H, W), each in a half window (N,), by the
// noise of the picture (H, W) itself.
Array<double, 3> corner_covariances(View<const std::uint8_t, 2> image, View<const float, 2> smooth, ConstMatrix corners,
                                    View<const std::int64_t, 1> windows, const CornerNoise& model);

}  // namespace vbaa::detect
