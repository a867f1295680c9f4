#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include "bindings/picture.hpp"
#include "detect/colours.hpp"
#include "detect/crossings.hpp"
#include "detect/evidence.hpp"
#include "detect/free_shape.hpp"
#include "detect/path_search.hpp"
#include "detect/ridges.hpp"
#include "detect/shape_search.hpp"
#include "polyline.hpp"
#include "scatter.hpp"
#include "smooth.hpp"

namespace vbaa {
namespace {

using detect::Crossings;

constexpr int LONG = 1'000'000;  // longer than any run of values

void require_pixels(double px) { require(px >= 0.0 && px < 1e4, "a width or reach is 0 to 10000 px"); }

ConstMatrix rows_of(const InMatrix& array, std::size_t columns, std::size_t least, const char* rule) {
    require(array.shape(1) == columns && array.shape(0) >= least, rule);
    return view(array);
}

ConstMatrix points(const InMatrix& array) { return rows_of(array, 2, 0, "points are an array (K, 2)"); }

ConstMatrix line(const InMatrix& array) { return rows_of(array, 2, 2, "a polyline has two points (u, v) at least"); }

ConstMatrix looks_of(const InMatrix& array) { return rows_of(array, 4, 1, "looks are an array (PLACES, 4)"); }

ConstVector of_size(const InVector& array, std::size_t count) {
    require(array.shape(0) == count, "arrays of one number of points go together");
    return view(array);
}

detect::FreeShape free_shape(nb::handle shape) {
    const detect::FreeShape found{attribute<const double, 1>(shape, "clamp_m"),
                                  attribute<const double, 2>(shape, "axes"),
                                  attribute<const double, 2>(shape, "segments_m")};
    require(found.clamp_m.size() == 3 && found.axes.shape == std::array{3, 3} && found.segments_m.shape[1] == 3 &&
                found.segments_m.shape[0] > 0,
            "a free shape has a clamp (3,), axes (3, 3) and segments (S, 3)");
    return found;
}

// A copy of one of the crossings' arrays.
template <int N, class Field>
void field(nb::class_<Crossings>& found, const char* name, Field Crossings::* which) {
    const auto copied = [which](const Crossings& each) { return to_numpy(Array<double, N>(each.*which)); };
    found.def_prop_ro(name, copied, nb::rv_policy::move);
}

void bind_smooth(nb::module_& room) {
    nb::enum_<Beyond> beyond_ends(room, "Beyond");
    beyond_ends.value("zeros", Beyond::zeros).value("end_value", Beyond::end_value).value("mirrored", Beyond::mirrored);
    room.def("running_mean", [](InVector values, int size, Beyond beyond) {
        require(size > 0 && size < LONG, "a mean is of one value at least");
        return to_numpy(running_mean(view(values), size, beyond));
    });
    const auto of_numbers = [](InVector values, int size) {
        require(size > 0 && static_cast<std::size_t>(size) <= values.size(),
                "of one value at least, and of all at most");
        for (const double each : view(values)) require(!std::isnan(each), "values must be numbers");
        return view(values);
    };
    room.def("running_medians",
             [=](InVector values, int size) { return to_numpy(running_medians(of_numbers(values, size), size)); });
    room.def("running_maxima",
             [=](InVector values, int size) { return to_numpy(running_maxima(of_numbers(values, size), size)); });
    room.def("median", [](InVector values) {
        require(values.shape(0) > 0, "a median is of one value at least");
        return median(view(values));
    });
}

ScatterSettings scatter_settings(nb::handle object) {
    const auto whole = [&](const char* name) { return number<int>(object, name); };
    const auto real = [&](const char* name) { return number<double>(object, name); };
    const ScatterSettings found = {whole("scatter_points"), whole("rounds"),       whole("surely_points"),
                                   whole("intervals"),      whole("per_interval"), whole("lags"),
                                   real("lonely"),          real("gross_std"),     real("surely_std"),
                                   real("significant"),     real("slow")};
    require(found.scatter_points > 4 && found.intervals > 0 && found.per_interval > 0 && found.lags < LONG,
            "a smooth curve goes through five points and has a piece at least");
    return found;
}

void bind_scatter(nb::module_& room) {
    const auto about = [](const InMatrix& line, const InVector& sigma, const ScatterSettings& settings) {
        const ConstMatrix some = points(line);
        const ConstVector own = of_size(sigma, line.shape(0));
        return unlocked([&] { return about_curve(some, own, settings); });
    };
    room.def("off_smooth_curve", [=](InMatrix line, InVector sigma, nb::handle settings) {
        return to_numpy(about(line, sigma, scatter_settings(settings)).off);
    });
    room.def("point_scatter", [=](nb::list lines, nb::list sigma, nb::handle settings) {
        const ScatterSettings known = scatter_settings(settings);
        require(lines.size() == sigma.size(), "each line has its standard deviations");
        std::vector<AboutCurve> found;
        for (std::size_t k = 0; k < lines.size(); ++k) {
            AboutCurve line = about(nb::cast<InMatrix>(lines[k]), nb::cast<InVector>(sigma[k]), known);
            if (line.off.size()) found.push_back(std::move(line));
        }
        return scatter_about(found, known);
    });
}

void bind_polyline(nb::module_& room) {
    room.def("normals", [](InMatrix polyline) { return to_numpy(normals(line(polyline))); });
    room.def("resample", [](InMatrix polyline, double spacing) {
        for (const double each : points(polyline)) require(std::isfinite(each), "a polyline's points must be numbers");
        Resampled found = resample(view(polyline), spacing);
        return arrays(found.points, found.along);
    });
    room.def("nearest_on", [](InMatrix polyline, InMatrix others) {
        const auto along = line(polyline), some = points(others);
        Nearest found = unlocked([&] { return nearest_on(along, some); });
        return arrays(found.index, found.distance);
    });
    room.def("feet_on", [](InMatrix nodes, InMatrix slopes, InVector arclength, InMatrix others) {
        const auto along = line(nodes), rise = line(slopes), some = points(others);
        require(along.shape[0] > 1 && along.shape == rise.shape && arclength.size() == nodes.shape(0),
                "a curve has two nodes (M, 2) at least, slopes (M, 2) and arc lengths (M,)");
        for (const ConstMatrix& each : {along, rise, some}) {
            for (const double number : each) require(std::isfinite(number), "nodes, slopes and points must be numbers");
        }
        Feet found = unlocked([&] { return feet_on(along, rise, view(arclength), some); });
        return arrays(found.place, found.distance, found.normal);
    });
}

void bind_paths(nb::module_& room) {
    nb::class_<Crossings> found(room, "Crossings");
    field<2>(found, "points", &Crossings::points);
    field<1>(found, "along", &Crossings::along);
    field<1>(found, "stretch", &Crossings::stretch);
    field<1>(found, "bow", &Crossings::bow);
    field<2>(found, "across", &Crossings::across);
    field<2>(found, "profiles", &Crossings::profiles);
    const auto inside = [](const Crossings& each) { return to_flags(Array<unsigned char, 1>(each.inside)); };
    found.def_prop_ro("inside", inside, nb::rv_policy::move);
    room.def("crossings", [](InPicture image, InMatrix path_px, int half, double sign) {
        require_pixels(half);
        require(half > 0, "a profile has three pixels at least");
        const auto path = points(path_px);
        return unlocked([&, taken = picture(image)] { return detect::crossings(taken, path, half, sign); });
    });
    room.def("refine_path", [](InPicture image, InMatrix path_px, double width_px, double reach_px, double sign) {
        require_pixels(width_px);
        require_pixels(reach_px);
        const auto path = points(path_px);
        auto refined = unlocked(
            [&, taken = picture(image)] { return detect::refine_path(taken, path, width_px, reach_px, sign); });
        require(refined.size() > 0, "a path has two points at least, all of them numbers");
        return to_numpy(std::move(refined));
    });
}

void bind_ridges(nb::module_& room) {
    using InIndex = Numpy<const std::int32_t, 2>;
    const auto reduced = [](int factor, int pool, int reach, double height, double width) {
        require_pixels(std::max({factor, pool, reach}));
        require(factor > 0 && pool > 0 && reach > 0 && height > 0.0 && width > 0.0 && height < 1e5 && width < 1e5,
                "factors and reaches are positive, a picture has up to 100000 rows and columns");
        const auto part = [&](double size) { return std::max(static_cast<int>(size) / factor, 1); };
        return detect::PathTable{factor, pool, part(height), part(width), reach, {}, {}, {}};
    };
    room.def("places", [=](InCube paths_px, int factor, int pool, int reach, std::pair<int, int> size) {
        require(paths_px.shape(2) == 2, "paths are (P, S, 2)");
        detect::PathPlaces found =
            detect::places(view(paths_px), reduced(factor, pool, reach, size.second, size.first));
        return arrays(found.index, found.spans, found.weight);
    });
    room.def("path_scores", [=](InPicture image, InIndex index, InIndex spans, InVector weight, int factor, int pool,
                                int reach, bool brighter, bool darker) {
        const auto taken = picture(image);
        detect::PathTable paths =
            reduced(factor, pool, reach, static_cast<double>(image.shape(0)), static_cast<double>(image.shape(1)));
        require(index.shape(1) < LONG, "paths have less than 10^6 samples");
        require(spans.shape(0) == std::size_t{detect::DIRECTIONS} * paths.rows() && spans.shape(1) == 2,
                "spans are (directions times rows, 2)");
        paths.index = view(index), paths.spans = view(spans), paths.weight = of_size(weight, index.shape(0));
        for (int k = 0; k < paths.spans.shape[0]; ++k)
            require(paths.spans(k, 0) >= 0 && paths.spans(k, 1) <= paths.columns(), "spans lie in the picture");
        return to_numpy(unlocked([&] { return detect::path_scores(taken, paths, brighter, darker); }));
    });
    room.def("clearest_paths", [](InVector score, InCube paths_px, double apart_px, int count, double share) {
        require(paths_px.shape(2) == 2 && paths_px.shape(0) > 0, "paths are (P, S, 2)");
        return detect::clearest_paths(of_size(score, paths_px.shape(0)), view(paths_px), apart_px, count, share);
    });
}

void bind_shapes(nb::module_& room) {
    room.def("likely_shapes", [](InPicture image, InMatrix axis, InCube paths, double spacing_px, double width_px,
                                 InVector contacts, std::array<double, 2> clamp, InMatrix looks, nb::handle settings) {
        require_pixels(width_px);
        require_pixels(spacing_px);
        require(axis.shape(0) >= 4 && axis.shape(0) < 1000 && axis.shape(1) == 2, "an axis has 4 to 999 points (u, v)");
        const Array<double, 1> along = arc_lengths(view(axis));
        require(along[along.size() - 1] < 1e5, "an axis is less than 100000 px long");
        require(paths.shape(0) > 0 && paths.shape(1) > 1 && paths.shape(2) == 2, "paths are (P, S, 2)");
        require(width_px > 0.0 && contacts.shape(0) > 0 && contacts.shape(0) < 100, "there are 1 to 99 contacts");
        require((looks.shape(0) == 0 || looks.shape(0) == 8) && looks.shape(1) == 4, "looks are (8, 4) or (0, 4)");
        detect::ShapeFamily family = {view(axis),     view(paths), spacing_px, width_px,
                                      view(contacts), clamp[0],    clamp[1]};
        detect::EdgeModel model;
        for (auto [name, to] : {std::pair{"surface_spread", &model.spread},
                                {"edge_rate", &model.rate},
                                {"hidden_odds", &model.hidden},
                                {"hidden_root_odds", &model.hidden_root},
                                {"correlation_px", &model.correlation_px},
                                {"strain_std", &model.strain},
                                {"look_odds", &model.look}})
            *to = number<double>(settings, name);
        auto found =
            unlocked([&, taken = picture(image)] { return detect::likely_shapes(taken, family, view(looks), model); });
        nb::list answers;
        for (auto& one : found)
            answers.append(nb::make_tuple(one.evidence, one.bend, to_numpy(std::move(one.path_px)),
                                          to_numpy(std::move(one.odds))));
        return answers;
    });
    room.def("misfit", [](nb::handle free, InMatrix seen, InVector variance, std::array<double, 3> allowed,
                          double enough, InMatrix starts) {
        const auto shape = free_shape(free);
        const auto some = points(seen), from = rows_of(starts, detect::SHAPE_UNKNOWNS, 0, "a shape has five unknowns");
        const auto each = of_size(variance, seen.shape(0));
        return unlocked([&] { return detect::misfit(shape, some, each, {allowed.data(), {3}}, enough, from); });
    });
    room.def("means_of_runs", [](InMatrix px, InVector sigma, int most) {
        require(most > 0, "there is one run at least");
        detect::Runs runs = detect::means_of_runs(points(px), of_size(sigma, px.shape(0)), most);
        return arrays(runs.means, runs.variance);
    });
}

void bind_colours(nb::module_& room) {
    room.attr("RUN") = detect::RUN;
    room.attr("FOREIGN") = detect::FOREIGN;
    room.attr("MOSTLY_FOREIGN") = detect::MOSTLY_FOREIGN;
    room.def("colours_at", [](InPicture image, double level, InMatrix at) {
        return to_numpy(detect::colours_at(picture(image), level, points(at)));
    });
    room.def("foreign", [](InPicture image, double level, InMatrix at, InVector shares, InMatrix looks) {
        const auto each = of_size(shares, at.shape(0));
        detect::Foreign found = detect::foreign(picture(image), level, points(at), each, looks_of(looks));
        return nb::make_tuple(to_flags(std::move(found.other)), to_numpy(std::move(found.off)),
                              to_numpy(std::move(found.hue)), to_flags(std::move(found.tinted)));
    });
}

void bind_ribbons(nb::module_& room) {
    using InPlanes = Numpy<const float, 3>;
    room.attr("ROW_STEP") = detect::ROW_STEP;
    room.attr("DIRECTIONS_DOWN") = detect::DIRECTIONS_DOWN;
    const auto evidence = [](InPlanes planes, double width_px, InVector noise, InVector shading, InVector spread,
                             std::array<double, 3> shares, double gap) {
        require_pixels(width_px);
        require(planes.size() > 0, "planes (channels, H, W) are not empty");
        require(planes.shape(2) < LONG && planes.shape(1) < LONG && planes.shape(0) < 100,
                "a picture has less than 10^6 rows and columns");
        const double places = static_cast<double>(planes.shape(1)) * static_cast<double>(planes.shape(2)) + 1e5;
        require(places * detect::DIRECTIONS_DOWN < 2e9, "a picture has less than 8 million pixels");
        const auto each = of_size(noise, planes.shape(0)), shade = of_size(shading, planes.shape(0));
        const auto apart = of_size(spread, planes.shape(0));
        const detect::RibbonModel model{width_px, each, shade, apart, shares[0], shares[1], shares[2], gap};
        return to_numpy(unlocked([&] { return detect::ribbon_evidence(view(planes), model); }));
    };
    room.def("ribbon_evidence", evidence);
    const auto paths = [](InPlanes down, InPlanes across, InMatrix starts, InMatrix ends, std::array<double, 9> rules,
                          std::array<double, 2> slack, int count) {
        const auto turned = [](const InPlanes& one, const InPlanes& other) {
            return one.shape(0) == other.shape(2) / detect::ROW_STEP && one.shape(1) == detect::DIRECTIONS_DOWN;
        };
        require(turned(down, across) && turned(across, down),
                "evidence is an array (H/ROW_STEP, DIRECTIONS_DOWN, W) and one (W/ROW_STEP, DIRECTIONS_DOWN, H)");
        require(down.shape(2) < LONG && across.shape(2) < LONG && down.size() < 500'000'000,
                "a picture has less than 10^6 columns");
        require(count >= 0 && rules[5] >= 0.0 && rules[5] < 1e4, "a number of paths and how far apart they are");
        const auto first = points(starts), last = points(ends);
        const detect::PathRules each{rules[0], rules[1], rules[2], rules[3], rules[4], rules[5],
                                     rules[6], rules[7], slack,    rules[8], count};
        auto found = unlocked([&] { return detect::best_paths(view(down), view(across), first, last, each); });
        nb::list list;
        for (auto& one : found) list.append(nb::make_tuple(to_numpy(std::move(one.path_px)), one.evidence, one.cost));
        return list;
    };
    room.def("best_paths", paths);
}

}  // namespace

void bind_search(nb::module_& module) {
    nb::module_ room = module.def_submodule("search", "The antenna in a picture: corridor, paths, lines.");
    for (const auto bind :
         {bind_smooth, bind_scatter, bind_polyline, bind_paths, bind_ridges, bind_shapes, bind_colours, bind_ribbons})
        bind(room);
}

}  // namespace vbaa
