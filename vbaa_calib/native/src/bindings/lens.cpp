#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include "image_curve.hpp"
#include "lens_bindings.hpp"

namespace vbaa {
namespace {

using lens::Lens;

constexpr const char* PIXELS = "pixels must be (N, 2)";

Lens make(bool fisheye, InVector parameters) {
    check_lens(fisheye, view(parameters).shape[0]);
    return lens::prepared(fisheye, view(parameters));
}

auto project(const Lens& lens, InMatrix points, bool with_slopes) {
    check_last(points, 3, "points must be (N, 3)");
    const std::size_t n = points.shape(0), asked = with_slopes ? n : 0;
    auto pixels = room<double>(n, 2);
    auto valid = room<bool>(n);
    auto by_point = room<double>(asked, 2, 3), by_lens = room<double>(asked, 2, lens.parameters());
    nb::gil_scoped_release released;
    lens::project(lens, view(points), view(pixels), valid.data(), view(by_point), view(by_lens));
    return std::make_tuple(pixels, valid, by_point, by_lens);
}

// Results of a map of pixels (N, 2): WIDTH numbers each, and validity.
template <void (*MAP)(const Lens&, ConstMatrix, Matrix, bool*), int WIDTH>
auto of_pixels(const Lens& lens, InMatrix pixels) {
    check_last(pixels, 2, PIXELS);
    auto found = room<double>(pixels.shape(0), WIDTH);
    auto valid = room<bool>(pixels.shape(0));
    nb::gil_scoped_release released;
    MAP(lens, view(pixels), view(found), valid.data());
    return std::make_pair(found, valid);
}

auto rays_with_slopes(const Lens& lens, InMatrix pixels) {
    check_last(pixels, 2, PIXELS);
    const std::size_t n = pixels.shape(0);
    auto rays = room<double>(n, 3);
    auto by_pixel = room<double>(n, 3, 2), by_lens = room<double>(n, 3, lens.parameters());
    auto valid = room<bool>(n);
    nb::gil_scoped_release released;
    lens::rays_with_slopes(lens, view(pixels), view(rays), view(by_pixel), view(by_lens), valid.data());
    return std::make_tuple(rays, valid, by_pixel, by_lens);
}

auto normalized(const Lens& lens, InMatrix pixels, bool with_slopes) {
    check_last(pixels, 2, PIXELS);
    const std::size_t n = pixels.shape(0);
    auto points = room<double>(n, 2), slopes = room<double>(with_slopes ? n : 0, 4);
    auto valid = room<bool>(n);
    nb::gil_scoped_release released;
    double *at = points.data(), *by = slopes.data();
    lens::Normalized to = {{at, 2}, {at + 1, 2}, {}};
    for (int k = 0; with_slopes && k < 4; ++k) to.slopes[k] = {by + k, 4};
    lens::normalized_of_pixels(lens, view(pixels), to, valid.data());
    return std::make_tuple(points, valid, slopes);
}

auto normalized_by_lens(const Lens& lens, InMatrix points) {
    check_last(points, 2, "points must be (N, 2)");
    auto slopes = room<double>(points.shape(0), 2, lens.parameters());
    nb::gil_scoped_release released;
    lens::normalized_by_lens(lens, view(points), view(slopes));
    return std::make_tuple(slopes);
}

// The pose of the camera (3, 4), the plane's normal and offset (4,), axes (2 or 3, 3).
struct SeenFrom {
    std::array<double, 9> turn;
    std::array<double, 3> place;
    lens::Plane plane;

    SeenFrom(const InMatrix& pose, const InVector& plane_, const InMatrix& axes) {
        if (pose.shape(0) != 3 || pose.shape(1) != 4 || plane_.shape(0) != 4 || axes.shape(1) != 3 ||
            axes.shape(0) < 2 || axes.shape(0) > 3)
            throw nb::value_error("a pose is (3, 4), a plane (4,), axes (2 or 3, 3)");
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) turn[3 * i + j] = pose(i, j);
            place[i] = pose(i, 3);
        }
        plane = {{turn.data(), {3, 3}}, {place.data(), {3}}, {plane_.data(), {3}}, plane_(3), view(axes)};
    }
};

template <class T>
auto on_plane(const Lens& lens, Numpy<const T, 2> pixels, InMatrix pose, InVector plane, InMatrix axes) {
    check_last(pixels, 2, PIXELS);
    const SeenFrom from(pose, plane, axes);
    auto points = room<T>(pixels.shape(0), axes.shape(0));
    auto valid = room<bool>(pixels.shape(0));
    nb::gil_scoped_release released;
    lens::plane_of_pixels(lens, from.plane, view(pixels), view(points), valid.data());
    return std::make_pair(points, valid);
}

auto plane_slopes(const Lens& lens, InMatrix pixels, InMatrix pose, InVector plane, InMatrix axes,
                  bool by_calibration) {
    check_last(pixels, 2, PIXELS);
    const SeenFrom from(pose, plane, axes);
    auto slopes = room<double>(pixels.shape(0), axes.shape(0), by_calibration ? lens.parameters() + 6 : 2);
    nb::gil_scoped_release released;
    if (by_calibration) lens::plane_by_calibration(lens, from.plane, view(pixels), view(slopes));
    if (!by_calibration) lens::plane_by_pixel(lens, from.plane, view(pixels), view(slopes));
    return std::make_tuple(slopes);
}

Numpy<double, 1> copy_of(const std::vector<double>& values) {
    auto copy = room<double>(values.size());
    std::copy(values.begin(), values.end(), copy.data());
    return copy;
}

void check_curves(InMatrix arclength_m, InCube nodes, InCube slopes) {
    const std::size_t count = arclength_m.shape(1);
    if (count < 2 || arclength_m.shape(0) != nodes.shape(0) || view(nodes).shape != view(slopes).shape ||
        nodes.shape(0) < 1 || nodes.shape(1) != count || nodes.shape(2) != 2)
        throw nb::value_error("curves have nodes and slopes (K, M, 2) at arc lengths (K, M), M at least 2");
}

lens::ImageCurve first_of(InMatrix arclength_m, InCube nodes, InCube slopes) {
    check_curves(arclength_m, nodes, slopes);
    return {view(arclength_m).row(0), view(nodes).row(0), view(slopes).row(0)};
}

auto interpolate(InMatrix arclength_m, InCube nodes, InCube slopes, InVector at) {
    auto points = room<double>(at.shape(0), 2), along = room<double>(at.shape(0), 2);
    lens::interpolate(first_of(arclength_m, nodes, slopes), view(at), view(points), view(along));
    return std::make_pair(points, along);
}

auto feet(InMatrix arclength_m, InCube nodes, InCube slopes, InMatrix points) {
    check_last(points, 2, "points must be (N, 2)");
    auto found = room<double>(points.shape(0));
    lens::feet(first_of(arclength_m, nodes, slopes), view(points), view(found));
    return found;
}

auto whitened(InMatrix arclength_m, InCube nodes, InCube slopes, InMatrix points, InCube covariance) {
    check_curves(arclength_m, nodes, slopes);
    check_last(points, 2, "points must be (N, 2)");
    if (covariance.shape(0) != points.shape(0) || covariance.shape(1) != 2 || covariance.shape(2) != 2)
        throw nb::value_error("the covariance must be (N, 2, 2)");
    auto residuals = room<double>(points.shape(0), nodes.shape(0)), normals = room<double>(points.shape(0), 2);
    nb::gil_scoped_release released;
    const lens::ImageCurves curves = {view(arclength_m), view(nodes), view(slopes)};
    lens::whitened(view(points), view(covariance), curves, view(residuals), view(normals));
    return std::make_pair(residuals, normals);
}

}  // namespace

void bind_lens(nb::module_& module) {
    nb::set_leak_warnings(false);  // Python remembers lenses to its end
    auto room_of_lenses = module.def_submodule("lens", "Pixels and rays of every lens model, with all derivatives.");
    room_of_lenses.def("interpolate", &interpolate, "Points and derivatives (N, 2) of the first curve at (N,).");
    room_of_lenses.def("feet", &feet, "Arc lengths (N,) of the points of the first curve nearest to points (N, 2).");
    room_of_lenses.def("whitened", &whitened, "Residuals (N, K), and normals (N, 2) over standard deviations.");
    nb::class_<Lens>(room_of_lenses, "Lens", "A lens made ready, of a model and fx, fy, cx, cy, *distortion.")
        .def("__init__", [](Lens* at, bool fisheye, InVector p) { new (at) Lens(make(fisheye, p)); })
        .def("project", &project, nb::arg("points"), nb::arg("with_slopes") = false,
             "Pixels (N, 2), validity, and if asked for d(pixel)/d(point) (N, 2, 3), d(pixel)/d(lens) (N, 2, 4 + k).")
        .def("chart", &of_pixels<lens::chart_of_pixels, 2>,
             "Points (N, 2) on the model's chart of pixels (N, 2), and validity.")
        .def("unproject", &of_pixels<lens::rays_of_pixels, 3>, "Unit rays (N, 3) of pixels (N, 2), and validity.")
        .def("rays_with_slopes", &rays_with_slopes, "Rays, validity, derivatives by pixel and by lens.")
        .def("normalized", &normalized, nb::arg("pixels"), nb::arg("with_slopes") = false,
             "X/Z, Y/Z (N, 2) of pixels (N, 2), validity, and if asked for d(X/Z, Y/Z)/d(u, v) (N, 4).")
        .def("normalized_by_lens", &normalized_by_lens, "d(X/Z, Y/Z)/d(lens) (N, 2, 4 + k) of fixed pixels at (N, 2).")
        .def("on_plane", &on_plane<double>, "Coordinates (N, 2 or 3) m of pixels (N, 2) on a plane, and validity.")
        .def("on_plane", &on_plane<float>)
        .def("plane_slopes", &plane_slopes, "Their derivatives by the pixel, or by lens, turn and shift of the camera.")
        .def_ro("ideal_limit", &Lens::ideal_limit)
        .def_ro("distorted_limit", &Lens::distorted_limit)
        .def_prop_ro("undistorted", [](const Lens& lens) { return lens.path == lens::Path::none; })
        .def_prop_ro("radial", [](const Lens& lens) { return lens.path == lens::Path::radial; })
        .def_prop_ro(
            "nodes", [](const Lens& lens) { return copy_of(lens.table.nodes); }, nb::rv_policy::automatic)
        .def_prop_ro("nodes_per_unit", [](const Lens& lens) { return lens.table.nodes_per_unit; })
        .def_prop_ro("table_limit", [](const Lens& lens) { return lens.table.distorted_limit; })
        .def_prop_ro(
            "ideal_rim", [](const Lens& lens) { return copy_of(lens.ideal.radii); }, nb::rv_policy::automatic)
        .def_prop_ro("reach_rim", [](const Lens& lens) { return copy_of(lens.reach.radii); }, nb::rv_policy::automatic);
}

}  // namespace vbaa
