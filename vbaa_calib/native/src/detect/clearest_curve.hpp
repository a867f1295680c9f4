// The smooth curve along which a strip is clearest in all: where the antenna is faint no column's best place is to be
// trusted, only their sum along the antenna tells.
#pragma once

#include "detect/path_refinement.hpp"

namespace vbaa::detect {

// (K,) rows of the clearest curve, px from the strip's middle; and of the clearest that goes elsewhere, by more than a
// distance, (0,) where none does that is nearly as clear.
struct ClearestCurves {
    Array<double, 1> best, other;
};

// Of a strip's clarity (K, 2·reach + 1).
ClearestCurves clearest_curves(ConstMatrix clarity, const Curves& tried, double apart_px);

// (K, R) the highest of so many neighbours in each column of values (K, R).
Array<double, 2> highest_nearby(ConstMatrix values, int rows);

}  // namespace vbaa::detect
