// The module that Python imports: a submodule for each room.
#include "numpy.hpp"

#include <cmath>

namespace nb = nanobind;

namespace vbaa {
namespace {

// The tail's series takes over where the complementary error function is about to underflow.
Numpy<double, 1> log_normal_cdf(InVector x) {
    Array<double, 1> found(static_cast<int>(x.shape(0)));
    constexpr double log_root = 0.91893853320467274178;  // of 2π
    for (std::size_t n = 0; n < x.shape(0); ++n) {
        const double at = x(n), square = at * at;
        found(static_cast<int>(n)) =
            at < -30.0 ? -0.5 * square - log_root - std::log(-at) + std::log1p((3.0 / square - 1.0) / square)
                       : std::log(0.5 * std::erfc(-at * 0.70710678118654752440));
    }
    return to_numpy(std::move(found));
}

}  // namespace
}  // namespace vbaa

NB_MODULE(core, module) {
    nb::set_leak_warnings(false);  // what is cached lives until the interpreter ends
    module.doc() = "Compiled inner loops of vbaa_calib and estimator; arrays are float64 and contiguous.";
    vbaa::bind_lens(module);
    vbaa::bind_bundle(module);
    vbaa::bind_antenna(module);
    vbaa::bind_simulate(module);
    vbaa::bind_solver(module);
    vbaa::bind_search(module);
    vbaa::bind_surface(module);
    vbaa::bind_profile(module);
    vbaa::bind_table(module);
    vbaa::bind_board(module);
    module.def("log_normal_cdf", &vbaa::log_normal_cdf, "Logarithms (N,) of the normal distribution function at (N,).");
}
