#include "detect/profile.hpp"

#include "bindings/picture.hpp"
#include "detect/ribbon_line.hpp"
#include "detect/row_noise.hpp"

namespace vbaa {
namespace {

using namespace nb::literals;
using detect::CrossSection;
using detect::Numbers;

void require_pixels(double width_px, double blur_px, int reach_px) {
    require(width_px >= 0.0 && width_px < 1e3 && blur_px >= 0.0 && blur_px < 1e3 && reach_px > 0 && reach_px < 1e3,
            "width, blur and reach are 0 to 1000 px");
}

// Fields of a Centreline except the verdict, further input of `acceptance.accepted`, and how lopsided the line is.
nb::object answer(detect::MeasuredLine&& found) {
    const auto& line = found.line;
    auto& seen = found.evidence;
    const auto& end = found.end;
    constexpr const char* kinds[] = {"tip", "hidden", "border", "unsure"};
    const auto of_kept = [&](const auto& values) { return to_numpy(detect::selected(values, line.kept)); };
    const nb::object dict = nb::module_::import_("builtins").attr("dict");
    const nb::object centreline =
        dict("points_px"_a = of_kept(seen.everywhere), "sigma_px"_a = of_kept(line.sigma_px),
             "effective_px"_a = of_kept(line.effective_px), "seen"_a = seen.seen, "amplitude"_a = seen.height,
             "breadth"_a = line.breadth, "guide_px"_a = to_numpy(std::move(seen.guide)),
             "visibility"_a = to_numpy(std::move(seen.visibility)),
             "end_px"_a = to_numpy(Array<double, 1>(ConstVector(end.place.data(), {2}))), "end_std_px"_a = end.std_px,
             "end"_a = kinds[static_cast<int>(end.kind)], "noise"_a = line.noise, "sure"_a = line.sure);
    return nb::make_tuple(centreline, seen.inside, seen.root, line.changing, found.lopsided_px);
}

nb::object measured(const InPicture& image, const InMatrix& path_px, double width_px, int half, double sign,
                    double taper, double quiet, const detect::Shapes& shapes) {
    require_pixels(width_px, 0.0, half);
    require(taper > -2.0 && taper < 2.0, "an antenna tapers by less than twice its mean width");
    require(image.ndim() == 2 && path_px.shape(1) == 2 && path_px.shape(0) > 1, "a path (K, 2) is in a picture (H, W)");
    require(half > 1 && shapes.reach_px == half + 2,
            "shapes reach two pixels farther than profiles of five pixels or more");
    const auto taken = picture(image);
    const detect::Measuring how = {width_px, half, sign, taper, quiet, shapes};
    auto found = unlocked([&] { return detect::measured(taken, view(path_px), how); });
    return found ? answer(std::move(*found)) : nb::none();
}

auto to_its_end(const InPicture& image, const InMatrix& path_px, int half, const CrossSection& section, int polarity) {
    require_pixels(0.0, 0.0, half);
    require(image.ndim() == 2 && path_px.shape(1) == 2 && path_px.shape(0) > 1, "a path (K, 2) is in a picture (H, W)");
    const auto taken = picture(image);
    const detect::Look look = {section, half, 0.0, polarity < 0 ? -1.0 : 1.0};
    return to_numpy(unlocked([&] { return detect::to_its_end(taken, view(path_px), look); }));
}

nb::object measured_ribbon(const InPicture& image, const InMatrix& path_px, double width_px, double blur_px, int half,
                           nb::handle settings) {
    require_pixels(width_px, blur_px, half);
    require(path_px.shape(1) == 2 && path_px.shape(0) > 1 && half > 2, "a path is (K, 2), profiles have seven pixels");
    const auto taken = picture(image);
    detect::RibbonMeasuring how = {width_px, blur_px, half, image.ndim() == 3 && image.shape(2) >= 3 ? 3 : 1, {}};
    for (auto [name, to] : {std::pair{"width_std", &how.priors.width_std},
                            {"blur_std", &how.priors.blur_std},
                            {"taper_std", &how.priors.taper_std},
                            {"shades", &how.priors.shades},
                            {"bend_px", &how.priors.bend_px},
                            {"knot_px", &how.priors.knot_px},
                            {"alike", &how.priors.alike},
                            {"change_px", &how.priors.change_px},
                            {"cut", &how.priors.cut}})
        *to = number<double>(settings, name);
    how.priors.passes = number<int>(settings, "passes");
    auto found = unlocked([&] { return detect::measured_ribbon(taken, view(path_px), how); });
    return found ? answer(std::move(*found)) : nb::none();
}

}  // namespace

void bind_profile(nb::module_& module) {
    nb::module_ room = module.def_submodule("profile", "The antenna in a picture: profiles, ends, acceptance.");
    room.attr("QUIET") = detect::QUIET;
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
    room.def("to_its_end", to_its_end);
    room.def("measured", measured);
    room.def("row_noise", [](InPicture image, InMatrix points_px, int axis, int band, int least) {
        require(points_px.shape(1) == 2 && points_px.shape(0) > 0, "points are an array (N, 2), not empty");
        for (const double each : view(points_px)) require(std::abs(each) < 1e9, "points are numbers of pixels");
        require((axis == 0 || axis == 1) && band >= 0 && band < 1e6, "rows are axis 1, columns 0, a band 0 to 10^6");
        auto found = detect::row_noise(picture(image), view(points_px), axis, band, least);
        return nb::make_tuple(to_numpy(std::move(found.alike)), found.std);
    });
    room.def("measured_ribbon", measured_ribbon);
}

}  // namespace vbaa
