#include <nanobind/stl/array.h>

#include "../simulate_casting.hpp"
#include "../simulate_picture.hpp"
#include "../simulate_stick_slip.hpp"
#include "rod.hpp"

namespace vbaa {

namespace {

Point vector_of(nb::handle object, const char* name) {
    auto values = attribute<const double, 1>(object, name);
    require(values.size() == 3, "an object's vectors are (3,)");
    return read<Point>(values.data);
}

void check_points(const InMatrix& points) { require(points.shape(1) == 3, "points and directions are (K, 3)"); }
void check_bumps(ConstMatrix bumps) { require(bumps.shape[1] == 5, "bumps are (K, 5)"); }

// An object as vbaa_calib.simulate.scene.objects.ObjectNumbers has it.
simulate::Object object_of(nb::handle object) {
    auto bumps = attribute<const double, 2>(object, "bumps");
    check_bumps(bumps);
    const int kind = number<int>(object, "kind");
    require(simulate::CYLINDER <= kind && kind <= simulate::FREEFORM, "no such kind of object");
    Point axis = vector_of(object, "axis"), wedge = vector_of(object, "wedge"), side = cross(axis, wedge);
    return {kind,
            vector_of(object, "center_m"),
            axis,
            wedge,
            {unit(wedge - side), unit(wedge + side)},
            number<double>(object, "radius_m"),
            bumps};
}

// A body as vbaa_calib.simulate.render.object.Body has it.
simulate::Body body_of(nb::handle body) {
    auto sides = attribute<const double, 2>(body, "sides"), across = attribute<const double, 2>(body, "across");
    require(sides.shape[1] == 4 && across.size() == 9, "a body's sides are (K, 4), what lies across it (3, 3)");
    return {object_of(body.attr("object")), sides, read<Rotation>(across.data), number<double>(body, "reach_m"),
            number<double>(body, "steepest")};
}

auto both(simulate::Surfaces&& found) { return arrays(found.distances_m, found.normals); }

auto signed_distances(nb::handle object, const InMatrix& points_m) {
    check_points(points_m);
    simulate::Object kind = object_of(object);
    return both(unlocked([&] { return simulate::signed_distances(kind, view(points_m)); }));
}

auto rough_distances(nb::handle object, const InMatrix& points_m) {
    check_points(points_m);
    simulate::Object kind = object_of(object);
    return to_numpy(unlocked([&] { return simulate::rough_distances(kind, view(points_m)); }));
}

auto elevations(const InMatrix& points_m, double radius_m, const InMatrix& bumps) {
    check_points(points_m);
    check_bumps(view(bumps));
    return both(unlocked([&] { return simulate::elevations(view(points_m), radius_m, view(bumps)); }));
}

auto surface_radii(const InMatrix& directions, double radius_m, const InMatrix& bumps) {
    check_points(directions);
    check_bumps(view(bumps));
    return to_numpy(unlocked([&] { return simulate::surface_radii(view(directions), radius_m, view(bumps)); }));
}

int first_within(nb::handle object, const InCube& rotations, const InMatrix& origins_m, const InMatrix& points_m,
                 const InVector& room_m) {
    check_points(points_m);
    check_points(origins_m);
    require(points_m.shape(0) == room_m.size(), "each point has a room");
    require(rotations.shape(0) == origins_m.shape(0) && rotations.shape(1) == 3 && rotations.shape(2) == 3,
            "poses are (A, 3, 3) and (A, 3)");
    simulate::Object kind = object_of(object);
    nb::gil_scoped_release release;
    return simulate::first_within(kind, view(rotations), view(origins_m), view(points_m), view(room_m));
}

auto cast_rays(nb::handle body, const InVector& origin_m, const InMatrix& directions) {
    check_points(directions);
    auto drawn = body_of(body);
    auto origin = read_from<Point, 1>(origin_m);
    auto hits = unlocked([&] { return simulate::cast_rays(drawn, origin, view(directions)); });
    return arrays(hits.depths, hits.normals, hits.faces);
}

using InRays = Numpy<const float, 3>;

void check_map(const InRays& padded) {
    require(padded.shape(0) > 2 && padded.shape(1) > 2 && padded.shape(2) == 2, "a map of rays is (H + 2, W + 2, 2)");
}

auto rays_between(const InRays& padded, const InMatrix& pixels) {
    check_map(padded);
    require(pixels.shape(1) == 2, "pixels are (N, 2)");
    return to_numpy(simulate::rays_between(view(padded), view(pixels)));
}

using InPlane = Numpy<const float, 2>;

auto surroundings(const InRays& padded, const InMatrix& R_world_camera, const InPlane& bench, double reach) {
    check_map(padded);
    require(bench.shape(0) > 1 && bench.shape(0) == bench.shape(1) && reach > 0.0,
            "a bench is (T, T), its reach above 0");
    auto turn = read_from<Rotation, 2>(R_world_camera);
    return to_numpy(unlocked([&] { return simulate::surroundings(view(padded), turn, view(bench), reach); }));
}

// left, top, columns, rows, factor
simulate::Window window_of(const InRays& padded, std::array<int, 5> window) {
    check_map(padded);
    const simulate::Window where = {window[0], window[1], window[2], window[3], window[4]};
    require(where.left >= 0 && where.top >= 0 && where.columns > 0 && where.rows > 0 &&
                where.left <= static_cast<int>(padded.shape(1)) - 2 - where.columns &&
                where.top <= static_cast<int>(padded.shape(0)) - 2 - where.rows && where.factor > 0 &&
                2.0 * where.columns * where.rows * where.factor * where.factor < 2e9,
            "a window lies in the picture");
    return where;
}

auto object_pixels(nb::handle body, const InVector& origin_m, const InMatrix& turn, const InRays& padded,
                   std::array<int, 5> window, const InVector& lamp, double ambient) {
    const auto where = window_of(padded, window);
    const auto drawn = body_of(body);
    const auto origin = read_from<Point, 1>(origin_m);
    const auto rotation = read_from<Rotation, 2>(turn);
    const simulate::Light light = {read_from<Point, 1>(lamp), ambient};
    return to_numpy(
        unlocked([&] { return simulate::object_pixels(drawn, origin, rotation, view(padded), where, light); }));
}

auto sheet_pixels(const InRays& padded, std::array<int, 5> window, const InMatrix& texel_from_ray,
                  const Numpy<const std::uint32_t, 2>& blocks, std::array<double, 2> print, std::array<int, 2> inked) {
    const auto where = window_of(padded, window);
    require(0 <= inked[0] && inked[0] < inked[1] && inked[1] <= where.rows, "a window has rows");
    require(blocks.shape(0) > 3 && blocks.shape(1) > 3 && static_cast<double>(blocks.size()) < 1e9,
            "a sheet has texels");
    auto map = read_from<Rotation, 2>(texel_from_ray);
    const simulate::Print printed = {print[0], print[1], inked[0], inked[1]};
    return to_numpy(unlocked([&] { return simulate::sheet_pixels(view(padded), where, map, view(blocks), printed); }));
}

auto blurred_change(const InPlane& canvas, const InPlane& brightness, const InPlane& covered,
                    std::array<int, 3> corner_and_factor, double sigma_px) {
    const auto [left, top, factor] = corner_and_factor;
    const int rows = static_cast<int>(brightness.shape(0)), columns = static_cast<int>(brightness.shape(1));
    require(factor > 0 && rows > 0 && columns > 0 && rows % factor == 0 && columns % factor == 0 &&
                covered.shape(0) == brightness.shape(0) && covered.shape(1) == brightness.shape(1),
            "brightness and what is covered are (rows·factor, factor·columns)");
    require(left >= 0 && top >= 0 && left <= static_cast<int>(canvas.shape(1)) - columns / factor &&
                top <= static_cast<int>(canvas.shape(0)) - rows / factor,
            "a patch lies in its canvas");
    require(sigma_px >= 0.0 && sigma_px < 1e3, "blur is 0 to 1000 px");
    const simulate::Window where = {left, top, columns / factor, rows / factor, factor};
    return to_numpy(unlocked(
        [&] { return simulate::blurred_change(view(canvas), view(brightness), view(covered), where, sigma_px); }));
}

auto digitised(const InPlane& grey, double electrons_per_grey, double read_noise, std::uint32_t seed) {
    require(electrons_per_grey > 0.0 && read_noise >= 0.0, "electrons are above 0, noise is not below");
    return to_numpy(unlocked([&] { return simulate::digitised(view(grey), electrons_per_grey, read_noise, seed); }));
}

auto spline(const InVector& places, const InMatrix& points, const InVector& at) {
    require(places.size() > 3 && places.size() == points.shape(0), "a spline goes through four points or more");
    auto found = unlocked([&] { return simulate::spline(view(places), view(points), view(at)); });
    return arrays(found[0], found[1]);
}

auto tube_parts(const InMatrix& curve, std::array<int, 2> size, int room, int factor, double asymmetry) {
    const int width = size[0], height = size[1];
    require(curve.shape(0) > 0 && curve.shape(1) == 9 && room >= 0 && room < 10000 && factor > 0 && factor < 100,
            "a tube's samples are (N, 9)");
    require(width > 0 && height > 0 && 1.0 * width * height < 3e8, "a picture has 1 to 3·10^8 pixels");
    auto found = unlocked([&] { return simulate::tube_parts(view(curve), width, height, room, factor, asymmetry); });
    nb::list parts;
    for (simulate::TubePart& part : found)
        parts.append(nb::make_tuple(part.left, part.top, to_numpy(std::move(part.fine)),
                                    to_numpy(std::move(part.covered)), to_numpy(std::move(part.seen))));
    return parts;
}

auto advance(nb::handle rod, nb::handle object, std::array<double, 5> touching, const InCube& frames,
             const InCube& ends) {
    require(frames.shape(1) == 7 && frames.shape(2) == 3 && ends.shape(0) == frames.shape(0) && ends.shape(1) == 2 &&
                ends.shape(2) == 23,
            "frames are (B, 7, 3), their ends (B, 2, 23)");
    auto numbers = rod_of(rod);
    auto kind = object_of(object);
    simulate::Touching units = {touching[0], touching[1], touching[2], touching[3], touching[4]};
    auto found = unlocked([&] { return simulate::advance(numbers, kind, units, view(frames), view(ends)); });
    return arrays(found.held, found.good);
}

auto gripped(const InVector& now, const InVector& pull, const InMatrix& spring, double press, const InVector& lift,
             double friction) {
    require(spring.size() == 4, "the spring is (2, 2)");
    simulate::Pair rows[] = {read<simulate::Pair>(spring.data()), read<simulate::Pair>(spring.data() + 2)};
    auto grip = simulate::gripped({read_from<simulate::Pair, 1>(now),
                                   read_from<simulate::Pair, 1>(pull),
                                   {rows[0], rows[1]},
                                   press,
                                   read_from<simulate::Pair, 1>(lift),
                                   friction});
    return std::make_tuple(grip.first, grip.second);
}

}  // namespace

void bind_simulate(nb::module_& module) {
    auto room =
        module.def_submodule("simulate", "The simulator's rods and pictures; shares nothing with what it tests.");
    room.def("signed_distances", &signed_distances,
             "Distances (K,) of points (K, 3) from an object, and normals there.");
    room.def("rough_distances", &rough_distances, "(K,) of points (K, 3): zero on the surface too, without a search.");
    room.def("elevations", &elevations, "F (K,) of a free form at points (K, 3) from its centre, and its gradients.");
    room.def("surface_radii", &surface_radii, "(K,) distance of a free form's surface from its centre.");
    room.def("first_within", &first_within, "The first of A poses that brings a point near; A where none does.");
    room.def("cast_rays", &cast_rays, "Depths (N,), normals (N, 3) and faces (N,) of the first hits of rays.");
    room.def("object_pixels", &object_pixels, "(2, H, W) float32 brightness and presence of a white object.");
    room.def("rays_between", &rays_between, "(N, 2) x/z and y/z at pixels (N, 2).");
    room.def("surroundings", &surroundings, "(H, W) float32 brightness of the bench where the pixels' rays end.");
    room.def("sheet_pixels", &sheet_pixels, "(2, H·F, F·W) float32 brightness and presence of a sheet.");
    room.def("blurred_change", &blurred_change,
             "(H, W) float32 what a patch changes in the blurred picture behind it.");
    room.def("digitised", &digitised, "(H, W) uint8 grey levels with noise.");
    room.def("spline", &spline, "(M, D) values and slopes of the cubic spline through points.");
    room.def("tube_parts", &tube_parts,
             "Of each stretch of a tube: left, top, brightness and covered part (2, H·F, F·W) float32; of covered "
             "sub-pixels their places (N,) int32, and pixels and depths (N, 3).");
    room.def("advance", &advance, "Contacts (B, 23) after a step with friction, and which were found (B,) uint8.");
    room.def("gripped", &gripped, "The grip that keeps Coulomb's law, two components.");
}

}  // namespace vbaa
