#include "detect/profile.hpp"

#include "bindings/picture.hpp"
#include "detect/reflectance.hpp"

namespace vbaa {
namespace {

using namespace nb::literals;
using detect::CrossSection;
using detect::Numbers;

template <class Work>
auto unlocked(const Work& work) {
    const nb::gil_scoped_release release;
    return work();
}

void require(bool holds, const char* rule) {
    if (!holds) throw nb::value_error(rule);
}

void require_pixels(double width_px, double blur_px, int reach_px) {
    require(width_px >= 0.0 && width_px < 1e4 && blur_px >= 0.0 && blur_px < 1e4 && reach_px > 0 && reach_px < 1e4,
            "width, blur and reach are 0 to 10000 px");
}

// Fields of a Centreline but for the verdict, and of acceptance.Evidence.
nb::object answer(detect::MeasuredLine&& found) {
    auto& [line, seen, end] = found;
    detect::Table points(detect::count(line.kept), 2);
    int k = 0;
    for (int n : detect::places(line.kept)) copy(seen.everywhere.row(n), points.row(k++));
    constexpr const char* kinds[] = {"tip", "hidden", "border", "unsure"};
    Array<double, 1> place(2);
    std::copy(end.place.begin(), end.place.end(), place.begin());
    nb::dict centreline, evidence;
    centreline["points_px"] = to_numpy(std::move(points));
    centreline["sigma_px"] = to_numpy(detect::selected(line.sigma_px, line.kept));
    centreline["effective_px"] = to_numpy(detect::selected(line.effective_px, line.kept));
    centreline["seen"] = seen.seen;
    centreline["amplitude"] = seen.height;
    centreline["breadth"] = line.breadth;
    centreline["guide_px"] = to_numpy(std::move(seen.guide));
    centreline["visibility"] = to_numpy(std::move(seen.visibility));
    centreline["end_px"] = to_numpy(std::move(place));
    centreline["end_std_px"] = end.std_px;
    centreline["end"] = kinds[static_cast<int>(end.kind)];
    centreline["noise"] = line.noise;
    centreline["familiar"] = seen.familiar;
    centreline["sure"] = line.sure;
    evidence["inside"] = seen.inside;
    evidence["root"] = seen.root;
    evidence["gap"] = seen.gap;
    evidence["spread_px"] = seen.spread_px;
    evidence["wander_px"] = seen.wander_px;
    evidence["snaking_rad"] = seen.snaking_rad;
    evidence["step"] = seen.step;
    evidence["transparency"] = seen.transparency;
    evidence["changing"] = line.changing;
    return nb::make_tuple(centreline, evidence);
}

nb::object measured(const InPicture& image, const InMatrix& path_px, double width_px, int half, int polarity,
                    double quiet, const detect::Shapes& shapes, const InMatrix& levels, bool stands_out) {
    require_pixels(width_px, 0.0, half);
    require(image.ndim() == 2 && path_px.shape(1) == 2 && path_px.shape(0) > 1, "a path (K, 2) is in a picture (H, W)");
    require(half > 1 && shapes.reach_px == half + 2,
            "shapes reach two pixels farther than profiles of five pixels or more");
    require(levels.shape(1) == 2 && levels.shape(0) != 1, "levels are an array (L, 2), at two places at least");
    const auto taken = picture(image);
    const detect::Measuring how = {width_px, half, polarity, quiet, shapes, view(levels), stands_out};
    auto found = unlocked([&] { return detect::measured(taken, view(path_px), how); });
    return found ? answer(std::move(*found)) : nb::none();
}

}  // namespace

void bind_profile(nb::module_& module) {
    nb::module_ room =
        module.def_submodule("profile", "The antenna in a picture: profiles, reflectance, ends, acceptance.");
    nb::class_<CrossSection>(room, "CrossSection");
    nb::class_<detect::Shapes>(room, "Shapes");
    room.def("expected", [](double width_px, double blur_px, int reach_px) {
        require_pixels(width_px, blur_px, reach_px);
        return unlocked([&] { return detect::expected(width_px, blur_px, reach_px); });
    });
    room.def("shapes", [](double width_px, double blur_px, int reach_px) {
        require_pixels(width_px, blur_px, reach_px);
        return unlocked([&] { return detect::shapes(width_px, blur_px, reach_px); });
    });
    room.def("fit", [](const CrossSection& section, const detect::Crossings& found, InVector centre) {
        require(centre.shape(0) == static_cast<std::size_t>(found.along.size()), "every profile has a centre");
        auto fits = unlocked([&] { return detect::fit(section, found, view(centre)); });
        return nb::make_tuple(to_numpy(std::move(fits.shift)), to_numpy(std::move(fits.height)),
                              to_numpy(std::move(fits.unit_height)), to_numpy(std::move(fits.rms)));
    });
    room.def("stiffened", [](InMatrix path_px) {
        require(path_px.shape(1) == 2 && path_px.shape(0) > 0, "a path is an array (K, 2), not empty");
        return to_numpy(unlocked([&] { return detect::stiffened(view(path_px)); }));
    });
    room.def("measured", measured);
    room.def("blurred_polynomials", [](double width_px, double blur_px, int reach_px) {
        require_pixels(width_px, blur_px, reach_px);
        return to_numpy(detect::blurred_polynomials({width_px, blur_px}, reach_px));
    });
}

}  // namespace vbaa
