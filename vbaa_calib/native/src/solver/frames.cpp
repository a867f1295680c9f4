#include "solver/frames.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

#include "lens.hpp"

namespace vbaa::solver {
namespace {

// Weight of the other coordinate when points are put in order: it separates points of one column.
constexpr double SLIGHTLY = 1e-6;

// Ends a frame's rows behind its points: the last one is repeated, so that lanes are whole.
void end_rows(Frame& frame, int count) {
    frame.count = count;
    for (int k = 0; k < 5; ++k) {
        double* row = frame.points.row(k).data;
        std::fill(row + count, row + frame.points.shape[1], count ? row[count - 1] : 0.0);
    }
    std::fill(frame.clamp.begin() + count, frame.clamp.end(), count ? frame.clamp[count - 1] : 0);
    frame.seen_by = count ? frame.clamp[0] / NODES : 0;
}

// Writes a frame's points, row by row.
template <class Row>
void put_points(Frame& frame, int count, Row&& row_of) {
    frame.points = Array<double, 2>(Unset{}, 5, whole_lanes(count));
    frame.clamp = Array<int, 1>(Unset{}, whole_lanes(count));
    for (int i = 0; i < count; ++i) {
        const std::array<double, 5> row = row_of(i, frame.clamp[i]);
        for (int k = 0; k < 5; ++k) frame.points(k, i) = row[k];
    }
    end_rows(frame, count);
}

// The least and the most u and v of points (N, 2); NaN is neither.
void extents(ConstMatrix points, double (&range)[2][2]) {
    Lanes least = spread(INFINITE), most = spread(-INFINITE);
    const double* numbers = points.begin();  // u and v in turn
    int i = 0;
    for (; i + LANES <= points.size(); i += LANES) {
        const Lanes here = load(numbers + i);
        least = choose(here < least, here, least);
        most = choose(here > most, here, most);
    }
    for (; i < points.size(); ++i) {
        least[i % LANES] = std::min<double>(least[i % LANES], numbers[i]);
        most[i % LANES] = std::max<double>(most[i % LANES], numbers[i]);
    }
    for (int axis = 0; axis < 2; ++axis) {
        range[axis][0] = INFINITE, range[axis][1] = -INFINITE;
        for (int lane = axis; lane < LANES; lane += 2) {
            range[axis][0] = std::min<double>(range[axis][0], least[lane]);
            range[axis][1] = std::max<double>(range[axis][1], most[lane]);
        }
    }
}

// Leaves out the points that cannot be used.
void close_up(Frame& frame, const Array<double, 1>& usable) {
    int count = 0;
    for (int i = 0; i < usable.size(); ++i) {
        if (!(usable[i] > 0.0)) continue;
        if (i > count) {
            for (int k = 0; k < 5; ++k) frame.points(k, count) = frame.points(k, i);
            frame.clamp[count] = frame.clamp[i];
        }
        ++count;
    }
    end_rows(frame, count);
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
    const int count = pixels.points.shape[1], wide = whole_lanes(count);
    thread_local Array<double, 1> usable, sigma;
    if (usable.size() != count) usable = sigma = Array<double, 1>(count);
    for (int i = 0; i < count; ++i) sigma[i] = pixels.sigma[index * pixels.sigma_apart + i * pixels.sigma_by_point];
    const auto camera_of = [&](int i) { return pixels.camera.size() ? static_cast<int>(pixels.camera(index, i)) : 0; };
    Frame frame = {};
    frame.points = Array<double, 2>(Unset{}, 5, wide);
    frame.clamp = Array<int, 1>(Unset{}, wide);
    for (int first = 0, end = 0; first < count; first = end) {
        const int camera = camera_of(first);
        while (end < count && camera_of(end) == camera) frame.clamp[end++] = camera * NODES;
        IdealColumns to;
        for (int k = 0; k < 5; ++k) to[k].first = &frame.points(k, first);
        ideal_points(*rig.cameras[camera].lens, pixels.points.row(index).part(first, end - first),
                     {&sigma[first], {end - first}}, to, {&usable[first], {end - first}});
    }
    close_up(frame, usable);
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
        double *at = frame.tip, *spread = frame.tip_covariance;
        ideal_points(*rig.cameras[sees_tip].lens, {end, {1, 2}}, {end + 2, {1}},
                     {{{at}, {at + 1}, {spread}, {spread + 1}, {spread + 2}}}, {&frame.available[END], {1}});
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
    const int every = std::max(frame.count / most, 1), count = frame.count;
    Thinned few = {frame, every};
    const auto gaps = [&](int begin, int end) {
        double total = 0.0;
        for (int i = begin + 1; i < end; ++i) {
            total += std::abs(frame.u()[i] - frame.u()[i - 1]) + std::abs(frame.v()[i] - frame.v()[i - 1]);
        }
        return total;
    };
    // neighbours with twice the usual gaps between them are not all at one place of the antenna
    const double most_gaps = count ? 2.0 * every / count * gaps(0, count) : 0.0;
    put_points(few.frame, (count + every - 1) / every, [&](int k, int& clamp) {
        const int begin = k * every, end = std::min(begin + every, count);
        const bool near = frame.clamp[begin] == frame.clamp[end - 1] && gaps(begin, end) <= most_gaps;
        const int first = near ? begin : few.middle(k, count), last = near ? end : first + 1;
        const double share = 1.0 / (last - first);
        std::array<double, 5> mean;
        for (int row = 0; row < 5; ++row) {
            const double* values = frame.points.row(row).data;
            mean[row] = share * std::accumulate(values + first, values + last, 0.0) * (row < 2 ? 1.0 : share);
        }
        clamp = frame.clamp[first];
        return mean;
    });
    return few;
}

void ideal_points(const lens::Lens& lens, ConstMatrix pixels, ConstVector sigma_px, const IdealColumns& to,
                  Vector usable) {
    const int count = pixels.shape[0];
    thread_local Array<double, 2> slopes;
    const auto valid = std::make_unique<bool[]>(count);
    if (slopes.shape[1] < count) slopes = Array<double, 2>(4, count);
    lens::Normalized places = {to[0], to[1], {}};
    for (int k = 0; k < 4; ++k) places.slopes[k].first = slopes.row(k).data;
    lens::normalized_of_pixels(lens, pixels, places, valid.get());
    const double *xu = slopes.row(0).data, *xv = slopes.row(1).data, *yu = slopes.row(2).data, *yv = slopes.row(3).data;
    const auto put = [&](int k, int i, double value) { to[k].first[i * to[k].apart] = value; };
    for (int i = 0; i < count; ++i) {
        const double variance = sigma_px[i] * sigma_px[i];
        usable[i] = valid[i] && std::isfinite(sigma_px[i]);
        put(2, i, variance * (xu[i] * xu[i] + xv[i] * xv[i]));
        put(3, i, variance * (xu[i] * yu[i] + xv[i] * yv[i]));
        put(4, i, variance * (yu[i] * yu[i] + yv[i] * yv[i]));
        if (usable[i] > 0.0) continue;
        for (int k = 0; k < 5; ++k) put(k, i, k == 2 || k == 4 ? 1.0 : 0.0);
    }
}

void places(ConstCube points_px, Matrix place, View<bool, 1> disordered, double (&extent)[2][2]) {
    for (int axis = 0; axis < 2; ++axis) extent[axis][0] = INFINITE, extent[axis][1] = -INFINITE;
    for (int b = 0; b < points_px.shape[0]; ++b) {
        const ConstMatrix points = points_px.row(b);
        const int count = points.shape[0];
        double range[2][2];
        extents(points, range);
        for (int axis = 0; axis < 2; ++axis) {
            extent[axis][0] = std::min(extent[axis][0], range[axis][0]);
            extent[axis][1] = std::max(extent[axis][1], range[axis][1]);
        }
        const int longer = range[0][1] - range[0][0] >= range[1][1] - range[1][0] ? 0 : 1;
        const auto place_of = [&](int n) { return points(n, longer) + SLIGHTLY * points(n, 1 - longer); };
        for (int n = 0; place.size() && n < count; ++n) place(b, n) = place_of(n);
        bool any = false;
        for (int n = 1; n < count; ++n) {
            const double here = place_of(n);
            // NaN before a number is out of order; NaN that fills up a row is not
            any |= here == here && !(here >= place_of(n - 1));
        }
        disordered[b] = any;
    }
}

}  // namespace vbaa::solver
