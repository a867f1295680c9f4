// The fit of frames. Arrays come as fields of Python's own objects (`RigArrays`, `Frames`, `FitNumbers`, …), by name.
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <atomic>

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "lens_bindings.hpp"
#include "rod.hpp"
#include "solver/convergence.hpp"
#include "solver/gradients.hpp"
#include "solver/initialization.hpp"
#include "solver/ladder.hpp"
#include "solver/linearised.hpp"
#include "solver/motion.hpp"
#include "solver/report.hpp"

namespace vbaa {
namespace {

using solver::Frames;
using solver::Rig;
using solver::UNKNOWNS;
using Released = nb::gil_scoped_release;

// Declares fields of one shape, by name.
template <class T, std::size_t N, class... More>
void read(nb::handle object, std::array<int, N> shape, const char* name, View<T, static_cast<int>(N)>& target,
          More&&... more) {
    target = attribute<T, static_cast<int>(N)>(object, name);
    if (target.shape != shape) throw nb::value_error((std::string(name) + " has another shape than is needed").c_str());
    if constexpr (sizeof...(more) > 0) read(object, shape, more...);
}

// Copies numbers from fields, by name.
template <class T, class... More>
void read_numbers(nb::handle object, const char* name, T& target, More&&... more) {
    target = number<T>(object, name);
    if constexpr (sizeof...(more) > 0) read_numbers(object, more...);
}

// Assign arrays of fields, by name, to as many views.
template <class T, class... More>
void read_copies(nb::handle object, const char* name, T& target, More&&... more) {
    nb::ndarray<const double, nb::c_contig, nb::device::cpu> values;
    if (!nb::try_cast(object.attr(name), values, false)) nb::raise_type_error("%s is no array of floats", name);
    require(values.nbytes() == sizeof target, name);
    std::copy_n(values.data(), values.size(), reinterpret_cast<double*>(&target));
    if constexpr (sizeof...(more) > 0) read_copies(object, more...);
}

solver::Camera camera_of(nb::handle object, int pose_at, int lens_at) {
    solver::Camera camera = {};
    camera.pose_at = pose_at, camera.lens_at = lens_at;
    camera.lens = nb::cast<const lens::Lens*>(object.attr("lens"));
    read_numbers(object, "focal", camera.focal);
    read_copies(object, "pose_lanes", camera.pose_lanes, "rotation", camera.rotation, "translation_m",
                camera.translation_m, "to_camera", camera.to_camera, "eye_m", camera.eye_m);
    camera.line = Array<double, 1>(attribute<const double, 1>(object, "line"));
    return camera;
}

// The core's rig from `RigArrays`; `cameras` keeps its lenses alive.
Rig rig_of(nb::handle object, const nb::tuple& cameras) {
    static std::atomic<int> made = 0;
    Rig rig = {};
    rig.made = made++;
    require(cameras.size() > 0, "a rig has a camera");
    read_numbers(object, "length_m", rig.length_m, "radius_m", rig.radius_m, "friction_rad", rig.friction_rad,
                 "force_unit_N", rig.force_unit_N, "unit_load", rig.unit_load, "tip_offset_m", rig.tip_offset_m,
                 "stiffness_Nm2", rig.stiffness_Nm2, "most_information", rig.most_information, "with_tip", rig.with_tip,
                 "with_wrench", rig.with_wrench, "with_lens", rig.with_lens, "readings", rig.readings);
    read_copies(object, "antenna_parameters", rig.antenna_parameters, "antenna_steps", rig.antenna_steps,
                "by_pose_step", rig.by_pose_step, "std", rig.std, "by_wrench", rig.by_wrench);
    require(rig.readings == solver::USUAL_READINGS || rig.readings == solver::READINGS, "readings must be 3 or 7");
    rig.by_sensor = Array<double, 3>(attribute<const double, 3>(object, "by_sensor"));
    require(rig.by_sensor.shape[0] >= solver::OF_MOMENT && rig.by_sensor.shape[1] == solver::READINGS &&
                rig.by_sensor.shape[2] == solver::WRENCH,
            "by_sensor must be (S, 7, 7)");
    rig.taper = read_taper(attribute<const double, 2>(object, "taper"));
    rig.unit_deflection = solver::unit_deflections(rig.taper);
    const ConstMatrix axes = attribute<const double, 2>(object, "axes");
    // the first camera's pose, antenna, sensor, the first lens, more of the sensor, tip; then each further camera
    int parameters = 0;
    const auto next = [&](int count) { return std::exchange(parameters, parameters + count); };
    for (nb::handle each : cameras) {
        const bool first = rig.cameras.empty();
        const int pose_at = next(first ? solver::POSES + solver::ANTENNA + solver::OF_MOMENT : solver::POSES);
        rig.cameras.push_back(camera_of(each, pose_at, parameters));
        if (rig.with_lens) next(rig.cameras.back().lens->parameters());
        require(rig.cameras.back().line.size() == rig.cameras[0].line.size(), "cameras' lines have other errors");
        if (!first) continue;
        rig.more_at = next(rig.by_sensor.shape[0] - solver::OF_MOMENT);
        rig.tip_at = next(rig.with_tip);
    }
    require(axes.shape[0] == parameters, "axes are not those of the rig's parameters");
    rig.shared = axes.shape[1];
    rig.axes = Array<double, 2>(axes.shape[0], whole_lanes(rig.shared));
    for (int q = 0; q < axes.shape[0]; ++q) std::copy_n(axes.row(q).data, rig.shared, rig.axes.row(q).data);
    for (std::size_t which = 0; which < rig.cameras.size(); ++which) {
        solver::Camera& camera = rig.cameras[which];
        const int lines = rig.shared + static_cast<int>(which) * camera.line.size();
        const auto depends_on = [&](int column) {
            const auto moved_by = [&](int first, int count) {
                for (int q = first; q < first + count; ++q) {
                    if (rig.axes(q, column) != 0.0) return true;
                }
                return false;
            };
            if (column >= rig.shared) return lines <= column && column < lines + camera.line.size();
            return moved_by(solver::POSES, solver::ANTENNA) || moved_by(camera.pose_at, solver::POSES) ||
                   moved_by(camera.lens_at, rig.with_lens ? camera.lens->parameters() : 0);
        };
        for (int column = -solver::UNKNOWNS; column < rig.steps(); ++column) {
            const int vector = (column + solver::UNKNOWNS) / LANES;
            if (!camera.vectors.empty() && camera.vectors.back() == vector) continue;
            if (column < 0 || depends_on(column)) camera.vectors.push_back(vector);
        }
    }
    return rig;
}

Frames frames_of(const Rig& rig, nb::handle object) {
    Frames frames;
    frames.usable = attribute<const double, 2>(object, "usable");
    const int count = frames.size(), points = frames.usable.shape[1];
    read(object, std::array{count, points, 2}, "points", frames.points);
    read(object, std::array{count, points, 3}, "covariance", frames.covariance);
    read(object, std::array{count, points}, "camera", frames.camera);
    read(object, std::array{count}, "tip_camera", frames.tip_camera);
    const auto of_rig = [&](std::int64_t camera) {
        return 0 <= camera && camera < static_cast<int>(rig.cameras.size());
    };
    require(std::all_of(frames.camera.begin(), frames.camera.end(), of_rig) &&
                std::all_of(frames.tip_camera.begin(), frames.tip_camera.end(), of_rig),
            "no such camera");
    read(object, std::array{count, 2}, "tip", frames.tip);
    read(object, std::array{count, rig.readings}, "reading", frames.reading, "available", frames.available);
    read(object, std::array{count, 3}, "tip_covariance", frames.tip_covariance, "gravity_m_s2", frames.gravity_m_s2);
    return frames;
}

// NumPy's description of a structure: names, kinds with their shapes, offsets, and the size.
template <class Row>
class Described {
  public:
    template <class Kind, class... More>
    void add(const char* name, Kind Row::* member, More... more) {
        std::string shape;
        add_shape<Kind>(shape);
        using Value = std::remove_all_extents_t<Kind>;
        names.append(name);
        shape += std::is_same_v<Value, bool> ? "?" : std::is_same_v<Value, double> ? "f8" : "i8";
        kinds.append(nb::str(shape.c_str()));
        offsets.append(reinterpret_cast<const char*>(&(row.*member)) - reinterpret_cast<const char*>(&row));
        if constexpr (sizeof...(more) > 0) add(more...);
    }
    nb::dict made() const {
        nb::dict found;
        found["names"] = names, found["formats"] = kinds, found["offsets"] = offsets, found["itemsize"] = sizeof(Row);
        return found;
    }

  private:
    template <class Kind>
    static void add_shape(std::string& shape) {
        if constexpr (std::is_array_v<Kind>) {
            shape += (shape.empty() ? "(" : "") + std::to_string(std::extent_v<Kind>) + ",";
            add_shape<std::remove_extent_t<Kind>>(shape);
        } else if (!shape.empty()) {
            shape += ')';
        }
    }

    Row row = {};
    nb::list names, kinds, offsets;
};

nb::dict numbers_described() {
    using N = solver::Numbers;
    Described<N> found;
    found.add("points", &N::points, "evaluations", &N::evaluations, "rung", &N::rung, "rig_axes", &N::rig_axes,
              "farthest_camera", &N::farthest_camera, "outliers", &N::outliers, "unknowns", &N::unknowns, "std",
              &N::std, "alternative_unknowns", &N::alternative_unknowns, "bias", &N::bias, "point_m", &N::point_m,
              "force_N", &N::force_N, "tangent", &N::tangent, "deflection_m", &N::deflection_m, "covariance",
              &N::covariance, "with_pose", &N::with_pose, "shared", &N::shared, "residual", &N::residual,
              "residual_std", &N::residual_std, "shared_std", &N::shared_std, "friction_share", &N::friction_share,
              "tip_std", &N::tip_std, "cost", &N::cost, "rig_chi_square", &N::rig_chi_square, "evidence", &N::evidence,
              "scatter", &N::scatter, "condition", &N::condition, "alternative_cost", &N::alternative_cost,
              "second_gain", &N::second_gain, "second_place", &N::second_place, "second_shift", &N::second_shift,
              "edge_on_rad", &N::edge_on_rad, "drift_px", &N::drift_px, "drift_readings", &N::drift_readings, "left_px",
              &N::left_px, "farthest", &N::farthest, "jump", &N::jump, "pieces_m", &N::pieces_m, "pieces_std_m",
              &N::pieces_std_m, "push", &N::push, "sensor_available", &N::sensor_available, "converged", &N::converged,
              "at_tip", &N::at_tip, "finite", &N::finite, "ambiguous", &N::ambiguous, "marginal", &N::marginal,
              "explained_alone", &N::explained_alone, "explained_drifted", &N::explained_drifted);
    return found.made();
}

nb::dict reported_described() {
    using R = solver::Reported;
    Described<R> found;
    found.add("distance_m", &R::distance_m, "distance_std_m", &R::distance_std_m, "distance_shared_std_m",
              &R::distance_shared_std_m, "force_covariance_yz_N2", &R::force_covariance_yz_N2, "moment_residual_Nm",
              &R::moment_residual_Nm, "friction_angle_rad", &R::friction_angle_rad, "friction_angle_std_rad",
              &R::friction_angle_std_rad, "evidence", &R::evidence, "point_shared_std_m", &R::point_shared_std_m,
              "force_shared_std_N", &R::force_shared_std_N, "force_N", &R::force_N, "force_std_N", &R::force_std_N,
              "deflection_m", &R::deflection_m, "point_antenna_m", &R::point_antenna_m, "point_world_m",
              &R::point_world_m, "force_world_N", &R::force_world_N, "tangent_world", &R::tangent_world,
              "covariance_world_m2", &R::covariance_world_m2, "in_contact", &R::in_contact);
    return found.made();
}

using Strided = nb::ndarray<const double, nb::ndim<2>, nb::device::cpu>;

// The arguments of `frames_from_pixels`: points, their standard deviations, readings, ends, gravity; with several
// cameras the indices of those that see each point and each end.
solver::Pixels pixels_of(const Rig& rig, const nb::tuple& measured) {
    require(measured.size() == 5 || measured.size() == 7, "pixels are five arrays, or seven of several cameras");
    const auto points = nb::cast<InCube>(measured[0], false);
    const auto sigma = nb::cast<Strided>(measured[1], false);
    const auto reading = nb::cast<InMatrix>(measured[2], false), tip = nb::cast<InMatrix>(measured[3], false);
    const auto gravity = nb::cast<InMatrix>(measured[4], false);
    solver::Pixels pixels = {};
    pixels.points = view(points), pixels.reading = view(reading), pixels.tip = view(tip);
    pixels.gravity_m_s2 = view(gravity);
    pixels.sigma = sigma.data(), pixels.sigma_apart = sigma.stride(0), pixels.sigma_by_point = sigma.stride(1);
    const int count = pixels.size(), wide = pixels.points.shape[1];
    require(pixels.points.shape[2] == 2 && static_cast<int>(sigma.shape(0)) == count &&
                static_cast<int>(sigma.shape(1)) == wide,
            "points must be (B, N, 2), their deviations (B, N)");
    require(pixels.reading.shape == std::array{count, solver::READINGS - 1}, "readings must be (B, 6)");
    require(pixels.tip.shape == std::array{count, 3} && pixels.gravity_m_s2.shape == std::array{count, 3},
            "ends and gravity must be (B, 3)");
    if (measured.size() == 5) return pixels;
    const auto camera = nb::cast<Numpy<const std::int64_t, 2>>(measured[5], false);
    const auto tip_camera = nb::cast<Numpy<const std::int64_t, 1>>(measured[6], false);
    pixels.camera = view(camera), pixels.tip_camera = view(tip_camera);
    require(pixels.camera.shape == std::array{count, wide} && pixels.tip_camera.size() == count, "cameras are (B, N)");
    const auto of_rig = [&](std::int64_t one) { return 0 <= one && one < static_cast<int>(rig.cameras.size()); };
    require(std::all_of(pixels.camera.begin(), pixels.camera.end(), of_rig) &&
                std::all_of(pixels.tip_camera.begin(), pixels.tip_camera.end(), of_rig),
            "no such camera");
    return pixels;
}

// The rigs for usual frames, for all frames, for rough minima, and without uncertainty.
solver::Rigs rigs_of(const nb::tuple& rigs_) {
    require(rigs_.size() == 4, "rigs must be four");
    const auto rig = [&](int index) -> const Rig& { return nb::cast<const Rig&>(rigs_[index]); };
    const solver::Rigs rigs = {rig(0), rig(1), rig(2), rig(3)};
    const auto alike = [&](const Rig& other) {
        return other.cameras.size() == rigs.usual.cameras.size() && other.readings == rigs.usual.readings;
    };
    require(alike(rigs.complete) && alike(rigs.rough) && alike(rigs.exact), "rigs differ in more than their axes");
    const int few = rigs.rough.shared;
    require(few <= rigs.usual.shared && few <= rigs.complete.shared && rigs.rough.lines() == rigs.usual.lines() &&
                rigs.rough.lines() == rigs.complete.lines(),
            "the rough rig has more axes than the others");
    return rigs;
}

// measured: `Frames`, or pixels.
void solve(const nb::tuple& rigs_, nb::handle measured, int begin, int end, int rung, InMatrix warm, InVector pieces_m,
           bool minima_only, nb::handle numbers) {
    const solver::Rigs rigs = rigs_of(rigs_);
    require(solver::AUTO <= rung && rung <= solver::ROD, "no such rung");
    require(pieces_m.size() == 0 || pieces_m.size() == solver::PIECES, "another number of pieces is tested");
    const auto solved = [&](const auto& frames) {
        const auto rows = structures<solver::Numbers>(numbers, frames.size());
        require(warm.size() == 0 || view(warm).shape == std::array{frames.size(), UNKNOWNS}, "warm must be (B, 4)");
        require(0 <= begin && end <= frames.size(), "begin and end must be frames");
        Released released;
        solver::solve_frames(rigs, frames, {begin, end, rung, view(warm), view(pieces_m), minima_only}, rows);
    };
    if (nb::isinstance<nb::tuple>(measured))
        solved(pixels_of(rigs.usual, nb::borrow<nb::tuple>(measured)));
    else
        solved(frames_of(rigs.usual, measured));
}

solver::Limits limits_of(nb::handle object) {
    solver::Limits found;
    read_numbers(object, "contact_evidence", found.contact_evidence, "edge_on_rad", found.edge_on_rad,
                 "edge_on_blind_rad", found.edge_on_blind_rad, "low_signal", found.low_signal, "low_signal_relative",
                 found.low_signal_relative, "alternative_cost", found.alternative_cost, "steepest", found.steepest,
                 "steepest_blind", found.steepest_blind, "second_contact", found.second_contact, "second_shift",
                 found.second_shift, "highest_bias", found.highest_bias, "contradiction", found.contradiction,
                 "disagreement", found.disagreement, "friction_share", found.friction_share, "outlying_std",
                 found.outlying_std, "jump", found.jump, "outlying_end", found.outlying_end, "fewest_points",
                 found.fewest_points);
    return found;
}

// Statuses of fits, and the bits of what was noticed.
struct JudgedRows {
    Numpy<std::int64_t, 1> status;
    Numpy<std::uint64_t, 1> noticed;

    JudgedRows(const solver::Limits& limits, View<const solver::Numbers, 1> numbers)
        : status(room<std::int64_t>(numbers.size())), noticed(room<std::uint64_t>(numbers.size())) {
        for (const solver::Numbers& each : numbers)
            require(0 <= each.rung && each.rung <= solver::REFERENCE, "no such rung");
        solver::judge(numbers, limits, {view(status), view(noticed)});
    }
};

auto judge(const solver::Limits& limits, nb::handle numbers) {
    const JudgedRows found(limits, structures<const solver::Numbers>(numbers));
    return std::make_pair(found.status, found.noticed);
}

// units: the antenna's length, the standard deviation of the friction angle, and that of the moment
auto report(const solver::Limits& limits, nb::handle numbers_, InCube rotation, InMatrix translation_m,
            const std::tuple<double, double, double>& units, nb::handle reported) {
    const auto numbers = structures<const solver::Numbers>(numbers_);
    const int count = numbers.size();
    const JudgedRows found(limits, numbers);
    const auto [length_m, friction_rad, moment_Nm] = units;
    const solver::Placed placed = {view(rotation), view(translation_m), length_m, friction_rad, moment_Nm};
    require(placed.rotation.shape == std::array{count, 3, 3} && placed.translation_m.shape == std::array{count, 3},
            "rotations must be (B, 3, 3), translations (B, 3)");
    solver::report(numbers, {view(found.status), view(found.noticed)}, placed,
                   structures<solver::Reported>(reported, count));
    return std::make_pair(found.status, found.noticed);
}

// Constants of fitting single frames of a rig with one camera.
struct Single {
    solver::Rigs rigs;
    solver::Limits limits;
    int rung, axes;                            // of the rig's errors
    double width, height, sigma_px;            // of its pictures, and a point's usual standard deviation
    double length_m, friction_rad, moment_Nm;  // length of the antenna; σ of friction angle and moment
};

// Fits and reports a frame. Returns its status and whether there is nothing to remark; None where points are out of
// order or outside the picture, or the fit is doubted.
nb::object fit_single(const Single& single, InMatrix points, const std::pair<double, double>& moments_Nm,
                      InCube rotation, InMatrix translation_m, InMatrix gravity_m_s2,
                      const std::pair<nb::handle, nb::handle>& rows) {
    constexpr double nothing = std::numeric_limits<double>::quiet_NaN();
    check_last(points, 2, "points must be (N, 2)");
    const auto numbers = structures<solver::Numbers>(rows.first, 1);
    const auto reported = structures<solver::Reported>(rows.second, 1);
    const solver::Placed placed = {view(rotation), view(translation_m), single.length_m, single.friction_rad,
                                   single.moment_Nm};
    require(placed.rotation.shape == std::array{1, 3, 3} && placed.translation_m.shape == std::array{1, 3} &&
                view(gravity_m_s2).shape == std::array{1, 3},
            "rotation must be (1, 3, 3), translation and gravity (1, 3)");
    std::int64_t status = 0;
    std::uint64_t noticed = 0;
    bool usual = false;
    {
        Released released;
        const int count = static_cast<int>(points.shape(0));
        const ConstCube line = {points.data(), {1, count, 2}};
        Array<double, 2> place(1, count);
        bool disordered = false;
        double extent[2][2];
        solver::places(line, place, {&disordered, {1}}, extent);
        const auto& [across, down] = extent;
        usual =
            !disordered && across[0] >= 0.0 && down[0] >= 0.0 && across[1] <= single.width && down[1] <= single.height;
        if (usual) {
            double reading[solver::READINGS - 1], tip[] = {nothing, nothing, nothing};
            std::fill_n(reading, solver::READINGS - 1, nothing);
            reading[0] = moments_Nm.first, reading[1] = moments_Nm.second;
            solver::Pixels pixels = {};
            pixels.points = line, pixels.sigma = &single.sigma_px;
            pixels.reading = {reading, {1, solver::READINGS - 1}}, pixels.tip = {tip, {1, 3}};
            pixels.gravity_m_s2 = view(gravity_m_s2);
            solver::solve_frames(single.rigs, pixels, {0, 1, single.rung, {}, {}, false}, numbers);
            numbers[0].rig_axes = single.axes;
            const solver::Judged judged = {{&status, {1}}, {&noticed, {1}}};
            solver::judge(numbers, single.limits, judged);
            usual = (noticed & solver::DOUBTED) == 0;
            if (usual) solver::report(numbers, judged, placed, reported);
        }
    }
    if (!usual) return nb::none();
    return nb::make_tuple(status, (noticed & solver::OUT_OF_ORDINARY) == 0);
}

void rough(const Rig& rig, nb::handle frames_, OutMatrix unknowns, OutCube points_m) {
    const Frames frames = frames_of(rig, frames_);
    require(view(unknowns).shape == std::array{frames.size(), UNKNOWNS}, "unknowns must be (B, 4)");
    require(view(points_m).shape == std::array{frames.size(), solver::NODES, 3}, "points must be (B, M, 3)");
    Released released;
    solver::rough_frames(rig, frames, view(unknowns), view(points_m));
}

void linearise(const Rig& rig, nb::handle frames_, int rung, InMatrix unknowns, nb::handle found_) {
    const Frames frames = frames_of(rig, frames_);
    const int count = frames.size(), size = UNKNOWNS + rig.steps();
    solver::Linearised found;
    read(found_, std::array{count, 3, solver::NODES}, "tangents", found.tangents);
    read(found_, std::array{count, 6}, "point_force", found.point_force);
    read(found_, std::array{count, 6, size}, "columns", found.columns);
    read(found_, std::array{count, rig.readings}, "residual", found.residual);
    read(found_, std::array{count, rig.readings, size}, "readings", found.readings);
    read(found_, std::array{count, size, size}, "information", found.information);
    read(found_, std::array{count, size}, "side", found.side, "prior", found.prior);
    read(found_, std::array{count}, "excess", found.excess);
    require(solver::PAPER <= rung && rung <= solver::ROD, "no such rung");
    require(view(unknowns).shape == std::array{count, UNKNOWNS}, "unknowns must be (B, 4)");
    Released released;
    solver::linearise_frames(rig, frames, rung, view(unknowns), found);
}

auto gradients(const Rig& rig, nb::handle frames_, int rung, InMatrix unknowns, InVector scatter,
               Numpy<const bool, 1> at_tip) {
    const Frames frames = frames_of(rig, frames_);
    const int count = frames.size(), results = solver::RESULTS;
    require(solver::PAPER <= rung && rung <= solver::ROD, "no such rung");
    require(view(unknowns).shape == std::array{count, UNKNOWNS}, "unknowns must be (B, 4)");
    require(view(scatter).shape == std::array{count} && view(at_tip).shape == std::array{count},
            "scatter and at_tip must be (B,)");
    auto by_points = room<double>(count, results, frames.usable.shape[1], 2);
    auto by_readings = room<double>(count, results, rig.readings), by_gravity = room<double>(count, results, 3);
    auto by_rig = room<double>(count, results, rig.axes.shape[0]);
    const solver::Gradients found = {view(by_points), view(by_readings), view(by_gravity), view(by_rig)};
    {
        Released released;
        solver::gradients(rig, frames, {rung, view(unknowns), view(scatter), view(at_tip)}, found);
    }
    return std::make_tuple(by_points, by_readings, by_gravity, by_rig);
}

void free_antennas(const Rig& rig, nb::handle frames_, InMatrix steps, double farthest_std, nb::handle found_) {
    const Frames frames = frames_of(rig, frames_);
    const int count = frames.size(), size = rig.steps();
    solver::FreeAntennas found;
    read(found_, std::array{count, size, size}, "information", found.information);
    read(found_, std::array{count, size}, "side", found.side);
    read(found_, std::array{count}, "gain", found.gain);
    require(view(steps).shape == std::array{count, size}, "steps must be (B, R)");
    Released released;
    solver::free_frames(rig, frames, view(steps), farthest_std, found);
}

auto edge_on(const Rig& rig, InMatrix unknowns) {
    require(unknowns.shape(1) >= 3, "unknowns must be (B, 3) or more");
    auto angles = room<double>(unknowns.shape(0));
    const ConstMatrix at = view(unknowns);
    for (int b = 0; b < at.shape[0]; ++b) {
        double most = 0.0;
        for (const solver::Camera& camera : rig.cameras) {
            most = std::max(most, solver::angle_edge_on(rig, camera, at.row(b).data));
        }
        angles.data()[b] = most;
    }
    return angles;
}

auto ideal_points(const Rig& rig, InCube pixels, InMatrix sigma_px, const Numpy<const std::int64_t, 1>& ends) {
    const int frames = static_cast<int>(pixels.shape(0)), wide = static_cast<int>(pixels.shape(1));
    check_last(pixels, 2, "pixels must be (B, N, 2)");
    require(view(sigma_px).shape == std::array{frames, wide}, "sigma_px must be (B, N)");
    require(ends.size() == rig.cameras.size(), "ends must be (V,)");
    for (std::size_t k = 0, first = 0; k < ends.size(); first = ends(k++)) {
        require(static_cast<std::int64_t>(first) <= ends(k) && ends(k) <= wide, "ends increase to N");
    }
    auto points = room<double>(frames, wide, 2), covariance = room<double>(frames, wide, 3);
    auto usable = room<double>(frames, wide);
    Released released;
    for (int b = 0; b < frames; ++b) {
        int first = 0;
        for (std::size_t k = 0; k < ends.size(); ++k) {
            const int count = static_cast<int>(ends(k)) - first;
            double *at = &view(points)(b, first, 0), *spread = &view(covariance)(b, first, 0);
            solver::ideal_points(*rig.cameras[k].lens, view(pixels).row(b).part(first, count),
                                 {view(sigma_px).row(b).data + first, {count}},
                                 {{{at, 2}, {at + 1, 2}, {spread, 3}, {spread + 1, 3}, {spread + 2, 3}}},
                                 {view(usable).row(b).data + first, {count}});
            first += count;
        }
    }
    return std::make_tuple(points, covariance, usable);
}

auto places(InCube points_px, bool with_places) {
    check_last(points_px, 2, "points must be (B, N, 2)");
    auto place = room<double>(with_places ? points_px.shape(0) : 0, points_px.shape(1));
    auto disordered = room<bool>(points_px.shape(0));
    double extent[2][2];
    {
        Released released;
        solver::places(view(points_px), view(place), view(disordered), extent);
    }
    return std::make_tuple(place, disordered, std::make_pair(extent[0][0], extent[0][1]),
                           std::make_pair(extent[1][0], extent[1][1]));
}

auto accelerations(InVector time_s, InCube points, InMatrix sigma, Numpy<const std::int64_t, 1> judged,
                   InVector mode_rad_s, double longest_s, int most, bool live) {
    const std::size_t count = time_s.size(), pieces = points.shape(1), asked = judged.size();
    require(points.shape(0) == count && points.shape(2) == 3, "points must be (n, G, 3)");
    require(sigma.shape(0) == count && (sigma.shape(1) == 1 || sigma.shape(1) == pieces), "std must be (n, 1 or G)");
    require(mode_rad_s.size() == asked && most >= 0 && most < 1000000, "mode_rad_s must be (R,), most 0 to 10^6");
    for (std::int64_t index : view(judged)) require(0 <= index && index < static_cast<int>(count), "no such frame");
    auto second = room<double>(asked, pieces, 3), deviation = room<double>(asked, pieces, 3);
    auto response = room<double>(asked);
    Released released;
    solver::accelerations({view(time_s), view(points), view(sigma)},
                          {view(judged), view(mode_rad_s), longest_s, most, live},
                          {view(second), view(deviation), view(response)});
    return std::make_tuple(second, deviation, response);
}

}  // namespace

void bind_solver(nb::module_& module) {
    auto room = module.def_submodule("solver", "The fit of frames: contacts with uncertainty and other minima.");
    nb::class_<Rig>(room, "Rig",
                    "What is known before a frame is seen, made of `RigArrays.core`'s fields and its cameras.")
        .def(
            "__init__",
            [](Rig* at, nb::handle fields, const nb::tuple& cameras) { new (at) Rig(rig_of(fields, cameras)); },
            nb::keep_alive<1, 3>());
    nb::class_<solver::Limits>(room, "Limits", "What decides on a frame's status: `ContactSettings`.")
        .def("__init__", [](solver::Limits* at, nb::handle settings) { new (at) solver::Limits(limits_of(settings)); });
    nb::class_<Single>(room, "Single", "How frames of a rig with one camera are fitted one by one.")
        .def(
            "__init__",
            [](Single* at, const nb::tuple& rigs, const solver::Limits& limits, const std::pair<int, int>& fitted,
               const std::tuple<double, double, double>& picture, const std::tuple<double, double, double>& units) {
                const auto [rung, axes] = fitted;
                const auto [width, height, sigma_px] = picture;
                const auto [length_m, friction_rad, moment_Nm] = units;
                require(solver::AUTO <= rung && rung <= solver::ROD, "no such rung");
                new (at) Single{rigs_of(rigs), limits,   rung,     axes,         width,
                                height,        sigma_px, length_m, friction_rad, moment_Nm};
                require(at->rigs.usual.cameras.size() == 1, "the rig has several cameras");
            },
            nb::keep_alive<1, 2>())
        .def("fit", &fit_single, "Fits a frame into rows of NUMBERS and REPORTED; its status, or none.");
    room.def("solve", &solve, "Fits frames from `begin` to `end` on a rung, −1: the highest, into rows of NUMBERS.");
    room.def("judge", &judge, "Statuses (B,) of fits, in their order, and what was noticed (B,), bits of Noticed.");
    room.def("report", &report, "Columns of `Contacts` into rows of REPORTED; gives what `judge` does.");
    room.def("rough", &rough, "Rough minima (B, 4) on a low rung and the antennas' nodes there (B, M, 3).");
    room.def("linearise", &linearise, "Frames on a rung at unknowns (B, 4), into `Linearised`.");
    room.def("gradients", &gradients,
             "Derivatives (B, 7, ...) of contacts at unknowns (B, 4) by points, readings, gravity and rig.");
    room.def("free_antennas", &free_antennas, "Frames as the free antenna about rig steps (B, R).");
    room.def("edge_on", &edge_on,
             "Angles (B,) between the deformation plane of unknowns (B, 4) and the line of sight.");
    room.def("ideal_points", &ideal_points,
             "Ideal points (B, N, 2) of pixels, covariances (B, N, 3), and which are usable; each camera's end at a "
             "column.");
    room.def(
        "places", &places,
        "Places (B, N) along the longer side of points (B, N, 2), which frames lack order, the extents of u and v.");
    room.def("accelerations", &accelerations, "Second derivatives of points in judged frames, their std, response.");
    room.attr("NUMBERS") = numbers_described();
    room.attr("REPORTED") = reported_described();
    room.attr("NEAREST") = solver::NEAREST;
    room.attr("EXCESS_SCATTER") = solver::EXCESS_SCATTER;
    room.attr("WRONG_SHAPE") = solver::WRONG_SHAPE;
    room.attr("MOST_EVALUATIONS") = solver::MOST_EVALUATIONS;
    room.attr("SMALL_BIAS") = solver::SMALL_BIAS;
    room.attr("PIECES") = solver::PIECES;
    room.attr("NODES") = solver::NODES;
    room.attr("MIRRORED") = static_cast<int>(solver::MIRRORED);
    room.attr("AT_CLAMP") = static_cast<int>(solver::AT_CLAMP);
    room.attr("TOO_STEEP") = static_cast<int>(solver::TOO_STEEP);
    room.attr("TWICE_TOUCHED") = static_cast<int>(solver::TWICE_TOUCHED);
    room.attr("UNEXPLAINED") = static_cast<int>(solver::UNEXPLAINED);
    room.attr("MODEL_TOO_LOW") = static_cast<int>(solver::MODEL_TOO_LOW);
    room.attr("FORCE_UNKNOWN") = static_cast<int>(solver::FORCE_UNKNOWN);
    room.attr("OUT_OF_ORDINARY") = static_cast<int>(solver::OUT_OF_ORDINARY);
    room.attr("FEWEST_POINTS") = solver::PointSettings().fewest;
    room.attr("STRETCH_STD") = solver::PointSettings().stretch_std;
    room.attr("SIDE") = solver::PointSettings().side;
    room.attr("DOUBTED") = static_cast<int>(solver::DOUBTED);
    room.attr("LANES") = LANES;
    room.attr("HUBER") = solver::HUBER;
    room.attr("END") = static_cast<int>(solver::END);
}

}  // namespace vbaa
