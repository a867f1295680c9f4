// A rough path moved onto the antenna: the best place across it, column by column, and a smooth curve through these.
#pragma once

#include "detect/picture.hpp"

namespace vbaa::detect {

// (K, 2) along what is brighter (sign 1) or darker (−1) than both flanks, at most `reach_px` off a path; no points
// where the path has no two columns.
Array<double, 2> refine_path(const Picture& picture, ConstMatrix path_px, double width_px, double reach_px,
                             double sign);

}  // namespace vbaa::detect
