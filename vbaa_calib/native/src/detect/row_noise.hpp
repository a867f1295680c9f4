// Noise that all pixels of a row, or of a column, of a picture share.
#pragma once

#include "detect/picture.hpp"
#include "detect/selection.hpp"

namespace vbaa::detect {

struct RowNoise {
    Numbers alike;     // (N,) how many of the points lie on the same row, within half a pixel
    double std = 0.0;  // of what a row's pixels share, grey levels; not measured where few points lie on one
};

// Of rows (axis 1) or columns (axis 0) up to `band` from points (N, 2), N > 0, where at least so many lie on the same.
RowNoise row_noise(const Picture& picture, ConstMatrix points, int axis, int band, int least);

}  // namespace vbaa::detect
