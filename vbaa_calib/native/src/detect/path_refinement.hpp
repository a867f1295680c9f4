// A rough path moved onto the antenna: the best place across it, column by column, and a smooth curve through these.
#pragma once

#include "detect/picture.hpp"

namespace vbaa::detect {

// A path that follows a ridge.
struct RefinedPath {
    Array<double, 2> path_px;  // (K, 2); none where the rough path has no two columns
    double share = 0.0;        // of the path along which there is a ridge
    double strength = 0.0;     // median height of the ridge where there is one, grey levels
};

// Along what is brighter (sign 1) or darker (−1) than both flanks, at most `reach_px` off a path (K, 2).
RefinedPath refine_path(const Picture& picture, ConstMatrix path_px, double width_px, double reach_px, double sign);

}  // namespace vbaa::detect
