// Covariances of a Gaussian process with a linear trend, seen by values and slopes: Matérn 5/2, in one or two
// coordinates (Rasmussen and Williams, Eqs. 4.17 and 9.1).
#pragma once

#include "arrays.hpp"

namespace vbaa {

// N views Σ value_c · h_c(x) + slope_c · ∇h_c(x) of C functions over D coordinates.
struct Functionals {
    ConstMatrix x;      // (N, D)
    ConstMatrix value;  // (N, C)
    ConstCube slope;    // (N, C, D)

    int size() const { return x.shape[0]; }
};

struct MaternPrior {
    double length, amplitude;  // of the process
    double offset, incline;    // standard deviations of the trend and its slope
};

// Whether views are of one or two functions over one or two coordinates, the only ones supported.
bool is_small(const Functionals& views);

// (N, M) prior covariance of views, and its derivative by the logarithm of the length where there is room for it.
void matern_covariance(const Functionals& a, const Functionals& b, const MaternPrior& prior, Matrix covariance,
                       Matrix by_log_length);

}  // namespace vbaa
