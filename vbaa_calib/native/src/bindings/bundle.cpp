#include "bundle.hpp"

#include <nanobind/stl/tuple.h>

#include "lens_bindings.hpp"

namespace vbaa {
namespace {

using bundle::SHAPE;
using Indices = Numpy<const std::int64_t, 1>;

void check_bounds(View<const std::int64_t, 1> bounds, int count) {
    require(bounds.shape[0] > 0 && bounds[0] == 0 && bounds[bounds.shape[0] - 1] == count, "bounds go from 0 to N");
    for (int i = 1; i < bounds.shape[0]; ++i) require(bounds[i] >= bounds[i - 1], "bounds increase");
}

// The core's corners from `lens.bundle.Corners`.
bundle::Corners corners_of(nb::handle object) {
    const bundle::Corners found = {
        attribute<const double, 2>(object, "points_m"), attribute<const double, 3>(object, "deformation"),
        attribute<const double, 2>(object, "pixels"), attribute<const double, 1>(object, "weights"),
        attribute<const std::int64_t, 1>(object, "bounds")};
    const int n = found.points_m.shape[0];
    require(found.points_m.shape[1] == 3 && found.pixels.shape == std::array<int, 2>{n, 2} &&
                found.deformation.shape == std::array<int, 3>{n, 3, SHAPE} && found.weights.shape[0] == n,
            "corners are points (N, 3), deformation (N, 3, 5), pixels (N, 2), weights (N,)");
    check_bounds(found.bounds, n);
    return found;
}

// The core's priors from `lens.bundle.Priors`.
bundle::Priors priors_of(nb::handle object) {
    const bundle::Priors found = {attribute<const double, 1>(object, "mean"),
                                  attribute<const double, 1>(object, "std"),
                                  number<double>(object, "tail"),
                                  number<double>(object, "noise_px"),
                                  number<double>(object, "least_slope"),
                                  number<double>(object, "stiffness_px"),
                                  number<double>(object, "width"),
                                  number<double>(object, "height")};
    require(found.mean.shape[0] == SHAPE && found.std.shape[0] == SHAPE, "a prior has mean (5,) and std (5,)");
    return found;
}

// The core's state from `lens.bundle.State`.
bundle::State state_of(nb::handle object, const bundle::Corners& corners) {
    bundle::State state;
    state.fisheye = number<bool>(object, "fisheye");
    state.lens = Array<double, 1>(attribute<const double, 1>(object, "lens"));
    state.shape = Array<double, 1>(attribute<const double, 1>(object, "shape"));
    state.poses = Array<double, 2>(attribute<const double, 2>(object, "poses"));
    check_lens(state.fisheye, state.lens.shape[0]);
    require(state.shape.shape[0] == SHAPE && state.poses.shape == std::array<int, 2>{corners.views(), bundle::POSE},
            "a state has shape (5,) and a pose (6,) for each view");
    return state;
}

auto descend(nb::handle start, nb::handle corners_, Indices column, nb::handle priors_, nb::handle rules_,
             bool robust) {
    const bundle::Corners corners = corners_of(corners_);
    const bundle::Priors priors = priors_of(priors_);
    bundle::State state = state_of(start, corners);
    const int size = state.lens.size() + SHAPE;
    require(static_cast<int>(column.shape(0)) == size, "column is (4 + k + 5,)");
    for (std::int64_t one : view(column)) require(one >= -1 && one < size, "column has unknowns from -1 on");
    const bundle::Rules rules = {number<int>(rules_, "iterations"), number<double>(rules_, "tolerance"),
                                 number<double>(rules_, "damping"), number<double>(rules_, "growth"),
                                 number<double>(rules_, "may_rise_share")};
    Array<double, 2> residuals(corners.pixels.shape[0], 2);
    {
        nb::gil_scoped_release released;
        const auto found = bundle::descend(state, corners, view(column), priors, rules, robust);
        std::copy(found.begin(), found.end(), residuals.begin());
    }
    return std::make_tuple(to_numpy(std::move(state.lens)), to_numpy(std::move(state.shape)),
                           to_numpy(std::move(state.poses)), to_numpy(std::move(residuals)));
}

auto corner_rows(nb::handle state_, nb::handle corners_) {
    const bundle::Corners corners = corners_of(corners_);
    const bundle::State state = state_of(state_, corners);
    const int n = corners.pixels.shape[0];
    Array<double, 2> residuals(n, 2);
    Array<double, 3> slopes(n, 2, state.lens.size() + SHAPE + bundle::POSE);
    {
        nb::gil_scoped_release released;
        bundle::corner_rows(state, corners, residuals, slopes);
    }
    return std::make_tuple(to_numpy(std::move(residuals)), to_numpy(std::move(slopes)));
}

auto unfolding_rows(InVector lens, bool fisheye, nb::handle priors) {
    check_lens(fisheye, view(lens).shape[0]);
    Array<double, 1> lacking(bundle::RADII);
    Array<double, 2> by_lens(bundle::RADII, lens.shape(0));
    const int count = bundle::unfolding_rows(view(lens), fisheye, priors_of(priors), lacking, by_lens);
    return std::make_tuple(to_numpy(Array<double, 1>(lacking.view().part(0, count))),
                           to_numpy(Array<double, 2>(by_lens.view().part(0, count))));
}

auto radial_slopes(InVector distortion, bool fisheye, InVector radii) {
    const int count = static_cast<int>(radii.shape(0));
    require(!fisheye || distortion.shape(0) == 4, "the fisheye has 4 coefficients");
    require(distortion.shape(0) <= 5 || distortion.shape(0) >= 8, "coefficients are 0, 4, 5, 8, 12 or 14");
    Array<double, 1> curve(count), slope(count);
    Array<double, 2> by(count, distortion.shape(0));
    for (int i = 0; i < count; ++i)
        bundle::radial_slope(view(distortion), fisheye, radii(i), curve[i], slope[i], by.row(i));
    return std::make_tuple(to_numpy(std::move(curve)), to_numpy(std::move(slope)), to_numpy(std::move(by)));
}

auto standardised(InMatrix residuals, InCube slopes, Numpy<const bool, 1> used, Indices bounds) {
    const int n = static_cast<int>(residuals.shape(0));
    require(residuals.shape(1) == 2 && view(slopes).shape == std::array<int, 3>{n, 2, 6} &&
                static_cast<int>(used.shape(0)) == n,
            "residuals are (N, 2), slopes (N, 2, 6), used (N,)");
    check_bounds(view(bounds), n);
    Array<double, 1> lengths(n);
    {
        nb::gil_scoped_release released;
        bundle::standardised(view(residuals), view(slopes), used.data(), view(bounds), lengths);
    }
    return to_numpy(std::move(lengths));
}

auto homography(InMatrix points, InMatrix image, Numpy<const std::int64_t, 2> picks, double division) {
    const auto n = static_cast<std::int64_t>(points.shape(0));
    require(points.shape(1) == 2 && image.shape(1) == 2 && points.shape(0) == image.shape(0) && picks.shape(1) == 4,
            "points and image are (N, 2), picks (S, 4)");
    for (std::int64_t one : view(picks)) require(one >= 0 && one < n, "picks are indices of the points");
    Array<double, 2> found(3, 3);
    double noise;
    {
        nb::gil_scoped_release released;
        noise = bundle::homography(view(points), view(image), view(picks), division, found);
    }
    return std::make_tuple(to_numpy(std::move(found)), noise);
}

}  // namespace

void bind_bundle(nb::module_& module) {
    auto room = module.def_submodule("bundle", "Board corners: robust homographies and bundle adjustment of the lens.");
    room.def("descend", &descend, nb::arg("state"), nb::arg("corners"), nb::arg("column"), nb::arg("priors"),
             nb::arg("rules"), nb::arg("robust"), "Lens, shape and poses of least cost, and the residuals (N, 2) px.");
    room.def("corner_rows", &corner_rows, "Residuals (N, 2) px and their negative derivatives (N, 2, 4 + k + 5 + 6).");
    room.def("unfolding_rows", &unfolding_rows, "Residuals (m,) px of radii that nearly fold, derivatives (m, 4 + k).");
    room.def("radial_slopes", &radial_slopes, "Distorted radii (m,), slopes (m,), and their derivatives (m, k).");
    room.def("standardised", &standardised, "Lengths (N,) of residuals over their standard deviations.");
    room.def("homography", &homography, "(3, 3), and the noise per axis; NaN where there is none.");
    room.def("corner_radius", [](InVector lens, double width, double height) {
        require(lens.shape(0) >= 4, "a lens has 4 parameters at least");
        return bundle::corner_radius(view(lens), width, height);
    });
}

}  // namespace vbaa
