// Prior covariances of a surface between contacts.
#include "matern.hpp"
#include "numpy.hpp"

namespace vbaa {
namespace {

Functionals functionals(nb::handle views) {
    const Functionals found = {attribute<const double, 2>(views, "x"), attribute<const double, 2>(views, "value"),
                               attribute<const double, 3>(views, "slope")};
    require(is_small(found), "one or two functions are seen over one or two coordinates");
    const int count = found.size(), functions = found.value.shape[1], coordinates = found.x.shape[1];
    require(found.value.shape[0] == count && found.slope.shape == std::array{count, functions, coordinates},
            "places, values and slopes are of other views");
    return found;
}

nb::tuple covariance(nb::handle a_, nb::handle b_, nb::handle prior_, bool with_slope) {
    const Functionals a = functionals(a_), b = functionals(b_);
    require(a.value.shape[1] == b.value.shape[1] && a.x.shape[1] == b.x.shape[1], "views are of other functions");
    const MaternPrior prior = {number<double>(prior_, "length_m"), number<double>(prior_, "amplitude_m"),
                               number<double>(prior_, "offset_m"), number<double>(prior_, "incline")};
    require(prior.length > 0.0, "length_m must be positive");
    const int wide = with_slope ? b.size() : 0;
    Array<double, 2> found(a.size(), b.size()), slope(a.size(), wide);
    {
        const nb::gil_scoped_release released;
        matern_covariance(a, b, prior, found, slope);
    }
    return arrays(found, slope);
}

}  // namespace

void bind_surface(nb::module_& module) {
    auto room = module.def_submodule("surface", "Surfaces between contacts.");
    room.def("covariance", &covariance,
             "Prior covariance (N, M) of views of a shape, and its derivative by the logarithm of the prior's length, "
             "(N, M) or (N, 0).");
}

}  // namespace vbaa
