#include "solver/frames.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "lens.hpp"

namespace vbaa::solver {
namespace {

// Weight of the other coordinate when points are put in order: it separates points of one column.
constexpr double SLIGHTLY = 1e-6;

// Space for a frame's points; padding repeats the last one.
template <class Row>
void put_points(Frame& frame, int count, Row&& row_of) {
    frame.count = count;
    frame.points = Array<double, 2>(5, whole_lanes(count));
    frame.clamp = Array<int, 1>(whole_lanes(count));
    for (int i = 0; i < frame.points.shape[1] && count; ++i) {
        const std::array<double, 5> row = row_of(std::min(i, count - 1), frame.clamp[i]);
        for (int k = 0; k < 5; ++k) frame.points(k, i) = row[k];
    }
    frame.seen_by = count ? frame.clamp[0] / NODES : 0;
}

}  // namespace

Frame frame_of(const Rig&, const Frames& frames, int index) {
    const ConstVector usable = frames.usable.row(index);
    std::vector<int> rows;
    rows.reserve(usable.size());
    for (int i = 0; i < usable.size(); ++i) {
        if (usable[i] > 0.0) rows.push_back(i);
    }
    Frame frame = {};
    put_points(frame, static_cast<int>(rows.size()), [&](int i, int& clamp) -> std::array<double, 5> {
        clamp = static_cast<int>(frames.camera(index, rows[i])) * NODES;
        const double *point = &frames.points(index, rows[i], 0), *spread = &frames.covariance(index, rows[i], 0);
        return {point[0], point[1], spread[0], spread[1], spread[2]};
    });
    std::copy_n(frames.reading.row(index).data, frames.reading.shape[1], frame.reading);
    std::copy_n(frames.tip.row(index).data, 2, frame.tip);
    std::copy_n(frames.tip_covariance.row(index).data, 3, frame.tip_covariance);
    frame.tip_clamp = static_cast<int>(frames.tip_camera[index]) * NODES;
    std::copy_n(frames.available.row(index).data, frames.available.shape[1], frame.available);
    std::copy_n(frames.gravity_m_s2.row(index).data, 3, frame.gravity_m_s2);
    return frame;
}

Frame frame_of(const Rig& rig, const Pixels& pixels, int index) {
    const int count = pixels.points.shape[1];
    thread_local Array<double, 2> points, covariance;
    thread_local Array<double, 1> usable, sigma;
    if (usable.size() != count) {
        points = Array<double, 2>(count, 2), covariance = Array<double, 2>(count, 3);
        usable = sigma = Array<double, 1>(count);
    }
    for (int i = 0; i < count; ++i) sigma[i] = pixels.sigma[index * pixels.sigma_apart + i * pixels.sigma_by_point];
    const auto camera_of = [&](int i) { return pixels.camera.size() ? static_cast<int>(pixels.camera(index, i)) : 0; };
    for (int first = 0, end = 0; first < count; first = end) {
        const int camera = camera_of(first);
        while (end < count && camera_of(end) == camera) ++end;
        ideal_points(*rig.cameras[camera].lens, pixels.points.row(index).part(first, end - first),
                     {&sigma[first], {end - first}}, points.view().part(first, end - first),
                     covariance.view().part(first, end - first), {&usable[first], {end - first}});
    }
    std::vector<int> rows;
    rows.reserve(count);
    for (int i = 0; i < count; ++i) {
        if (usable[i] > 0.0) rows.push_back(i);
    }
    Frame frame = {};
    put_points(frame, static_cast<int>(rows.size()), [&](int i, int& clamp) -> std::array<double, 5> {
        const int row = rows[i];
        clamp = camera_of(row) * NODES;
        return {points(row, 0), points(row, 1), covariance(row, 0), covariance(row, 1), covariance(row, 2)};
    });
    for (int reading = 0; reading < rig.readings; ++reading) {
        if (reading == END) continue;
        const auto& by = rig.by_wrench[reading];
        const double read = pixels.reading(index, reading - (reading > END));
        const bool known = std::isfinite(read) && std::any_of(by, by + WRENCH, [](double each) { return each != 0.0; });
        frame.reading[reading] = known ? read : 0.0;
        frame.available[reading] = known;
    }
    const int sees_tip = pixels.tip_camera.size() ? static_cast<int>(pixels.tip_camera[index]) : 0;
    frame.tip_clamp = sees_tip * NODES;
    frame.tip_covariance[0] = frame.tip_covariance[2] = 1.0;
    if (rig.with_tip) {
        const double* end = pixels.tip.row(index).data;
        ideal_points(*rig.cameras[sees_tip].lens, {end, {1, 2}}, {end + 2, {1}}, {frame.tip, {1, 2}},
                     {frame.tip_covariance, {1, 3}}, {&frame.available[END], {1}});
    }
    std::copy_n(pixels.gravity_m_s2.row(index).data, 3, frame.gravity_m_s2);
    return frame;
}

double information_of(const Frame& frame) {
    double total = 0.0;
    for (int i = 0; i < frame.count; ++i) total += 2.0 / (frame.xx()[i] + frame.yy()[i]);
    return total;
}

Thinned thinned(const Frame& frame, int most) {
    const int every = std::max(frame.count / most, 1);
    Thinned few = {frame, every};
    put_points(few.frame, (frame.count + every - 1) / every, [&](int i, int& clamp) -> std::array<double, 5> {
        const ConstMatrix points = frame.points;
        const int at = i * every;
        clamp = frame.clamp[at];
        return {points(0, at), points(1, at), points(2, at), points(3, at), points(4, at)};
    });
    return few;
}

void ideal_points(const lens::Lens& lens, ConstMatrix pixels, ConstVector sigma_px, Matrix points, Matrix covariance,
                  Vector usable) {
    const int count = pixels.shape[0];
    Array<double, 2> slopes(count, 4);
    const auto valid = std::make_unique<bool[]>(count);
    lens::normalized_of_pixels(lens, pixels, points, slopes, valid.get());
    for (int i = 0; i < count; ++i) {
        usable[i] = valid[i] && std::isfinite(sigma_px[i]);
        if (usable[i] > 0.0) {
            const double variance = sigma_px[i] * sigma_px[i], *slope = slopes.row(i).data;
            covariance(i, 0) = variance * (slope[0] * slope[0] + slope[1] * slope[1]);
            covariance(i, 1) = variance * (slope[0] * slope[2] + slope[1] * slope[3]);
            covariance(i, 2) = variance * (slope[2] * slope[2] + slope[3] * slope[3]);
        } else {
            points(i, 0) = points(i, 1) = covariance(i, 1) = 0.0;
            covariance(i, 0) = covariance(i, 2) = 1.0;
        }
    }
}

void places(ConstCube points_px, Matrix place, View<bool, 1> disordered, double (&extent)[2][2]) {
    constexpr double INFINITE = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 2; ++axis) extent[axis][0] = INFINITE, extent[axis][1] = -INFINITE;
    for (int b = 0; b < points_px.shape[0]; ++b) {
        double least[2], most[2];
        std::fill_n(least, 2, INFINITE);
        std::fill_n(most, 2, -INFINITE);
        for (int n = 0; n < points_px.shape[1]; ++n) {
            for (int axis = 0; axis < 2; ++axis) {
                // NaN is neither
                least[axis] = std::min(least[axis], points_px(b, n, axis));
                most[axis] = std::max(most[axis], points_px(b, n, axis));
            }
        }
        for (int axis = 0; axis < 2; ++axis) {
            extent[axis][0] = std::min(extent[axis][0], least[axis]);
            extent[axis][1] = std::max(extent[axis][1], most[axis]);
        }
        const int longer = most[0] - least[0] >= most[1] - least[1] ? 0 : 1;
        disordered[b] = false;
        for (int n = 0; n < points_px.shape[1]; ++n) {
            const double here = points_px(b, n, longer) + SLIGHTLY * points_px(b, n, 1 - longer);
            place(b, n) = here;
            // NaN before a number is out of order, those that fill up a row are not
            if (n > 0 && here == here && !(here >= place(b, n - 1))) disordered[b] = true;
        }
    }
}

}  // namespace vbaa::solver
