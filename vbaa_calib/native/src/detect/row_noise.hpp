// Noise that all pixels of a row, or of a column, of a picture share.
#pragma once

#include "detect/picture.hpp"
#include "detect/selection.hpp"

namespace vbaa::detect {

struct RowNoise {
    Numbers alike;     // (N,) how many of the points lie on the same row, within half a pixel
    double std = 0.0;  // of a row's common offset, grey levels; not measured where few points lie on one row
};

// Measures the noise of rows (axis 1) or columns (axis 0) up to `band` from points (N, 2), N > 0, if at least `least`
// points lie on the same one.
RowNoise row_noise(const Picture& picture, ConstMatrix points, int axis, int band, int least);

}  // namespace vbaa::detect
