// Which of many tabled paths show the most edges on both of their sides, in a reduced picture.
#pragma once

#include <memory>

#include "detect/edge_model.hpp"

namespace vbaa::detect {

// Which paths are tried.
struct RoughPaths {
    ConstCube paths_px;  // (P, T, 2)
    double spacing_px;   // by which the tips of neighbouring ones are apart
    double width_px;     // of the antenna
};

// Floats that nobody has set.
using Plane = std::unique_ptr<float[]>;

// A reduced picture's luma and colour differences, with more rows and columns on every side: its border's.
struct Reduced {
    int factor = 1, pool = 1;  // pixels in one; how far off a path its edges may be
    int rows = 0, columns = 0, pad = 0, stride = 0, tall = 0, channels = 0;
    std::array<Plane, MOST_CHANNELS> levels;

    int size() const { return stride * tall; }
    int at(int row, int column) const { return (row + pad) * stride + column + pad; }
};

// The picture reduced as the rough search needs it.
template <class T>
Reduced reduced(const Colours<T>& picture, const RoughPaths& paths);

// (P,) mean log odds of the paths. noise : deviation of a pixel of the picture, in each channel.
Numbers rough_scores(const Reduced& picture, const RoughPaths& paths, const Looks* looks, const Colour& noise,
                     const EdgeModel& model);

}  // namespace vbaa::detect
