#include "simulate_picture.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace vbaa::simulate {

namespace {

constexpr double AMBIENT = 0.45;
// Pixels farther than this from the tube's edge, or samples so far outside of the picture, are of no account.
constexpr double ROOM_PX = 2.5, BEYOND_PX = 50.0;

// Of the antenna, in the picture.
struct Sample {
    double u, v, tangent_u, tangent_v, normal_u, normal_v, half_width;
};

// The round tube's shading, integrated across it from its axis to u, −1 to 1.
double summed_shading(double u, double asymmetry) {
    double round_part = (u * std::sqrt(1.0 - u * u) + std::asin(u)) / 2;
    return AMBIENT * u + (1.0 - AMBIENT) * round_part + asymmetry * u * u / 2;
}

// The nearest of the tube's samples (height, width), −1 where none is near.
std::vector<int> nearest_samples(ConstMatrix curve, int width, int height) {
    double reach = ROOM_PX;
    for (int i = 0; i < curve.shape[0]; ++i) reach = std::max(reach, ROOM_PX + curve(i, 6));
    std::size_t pixels = static_cast<std::size_t>(width) * height;
    std::vector<double> distance(pixels, reach * reach);
    std::vector<int> nearest(pixels, -1);
    // the first pixel that a sample may reach, and one past the last
    auto first = [&](double place) { return static_cast<int>(std::max(place - reach, 0.0)); };
    auto last = [&](double place, int size) {
        return static_cast<int>(std::min(std::trunc(place + reach) + 2.0, static_cast<double>(size)));
    };
    for (int i = 0; i < curve.shape[0]; ++i) {
        double u = curve(i, 0), v = curve(i, 1);
        if (!(-BEYOND_PX < u && u < width + BEYOND_PX && -BEYOND_PX < v && v < height + BEYOND_PX)) continue;
        int left = first(u), right = last(u, width);
        for (int row = first(v); row < last(v, height); ++row) {
            double down = (row - v) * (row - v), *best = &distance[static_cast<std::size_t>(row) * width];
            int* which = &nearest[static_cast<std::size_t>(row) * width];
            for (int column = left; column < right; ++column) {
                double square = (column - u) * (column - u) + down;
                bool nearer = square < best[column];
                best[column] = nearer ? square : best[column];
                which[column] = nearer ? i : which[column];
            }
        }
    }
    return nearest;
}

}  // namespace

Array<double, 2> rays_between(ConstCube padded, ConstMatrix pixels) {
    Array<double, 2> rays(pixels.shape[0], 2);
    double rows = padded.shape[0] - 1.001, columns = padded.shape[1] - 1.001;
    for (int i = 0; i < pixels.shape[0]; ++i) {
        double u = std::min(std::max(0.0, pixels(i, 0) + 1.0), columns);
        double v = std::min(std::max(0.0, pixels(i, 1) + 1.0), rows);
        int column = static_cast<int>(u), row = static_cast<int>(v);
        double a = u - column, b = v - row, *ray = rays.values.data() + 2 * i;
        const double *upper = &padded(row, column, 0), *lower = &padded(row + 1, column, 0);
        for (int j = 0; j < 2; ++j) {
            double above = (1 - a) * upper[j] + a * upper[j + 2], below = (1 - a) * lower[j] + a * lower[j + 2];
            ray[j] = (1 - b) * above + b * below;
        }
    }
    return rays;
}

Array<float, 3> bench_texels(ConstCube padded, const Rotation& R_world_camera, int texels, double reach) {
    int height = padded.shape[0] - 2, width = padded.shape[1] - 2, half = texels / 2;
    Array<float, 3> found(height, width, 2);
    for (int row = 0; row < height; ++row)
        for (int column = 0; column < width; ++column) {
            Point ray = {padded(row + 1, column + 1, 0), padded(row + 1, column + 1, 1), 1.0};
            Point at = R_world_camera.turned(ray);
            // scaled by 1/n, not normalised first: u = dx / (|d| − dz)
            double below = std::max(norm(at) - at.z, 1e-3);
            found(row, column, 0) = static_cast<float>((at.x / below / reach + 1.0) * half);
            found(row, column, 1) = static_cast<float>((at.y / below / reach + 1.0) * half);
        }
    return found;
}

TubePixels tube_pixels(ConstMatrix curve, int width, int height, ConstMatrix inner, int divisions, double asymmetry) {
    std::vector<int> nearest = nearest_samples(curve, width, height);
    int count = 0, places = inner.shape[0];
    for (int sample : nearest) count += sample >= 0;
    TubePixels found = {Array<std::int64_t, 1>(count), Array<std::int64_t, 1>(count), Array<std::int64_t, 1>(count),
                        Array<double, 2>(count, places), Array<double, 2>(count, places)};
    double half = 0.5 / divisions;
    int k = 0;
    for (int i = 0; i < height * width; ++i) {
        if (nearest[i] < 0) continue;
        int row = i / width, column = i % width, at = nearest[i];
        Sample tube = read<Sample>(&curve(at, 0));
        found.rows[k] = row;
        found.columns[k] = column;
        found.nearest[k] = at;
        double *coverage = found.coverage.row(k).data, *shade = found.shade.row(k).data;
        for (int j = 0; j < places; ++j) {
            double x = column + inner(j, 0) - tube.u, y = row + inner(j, 1) - tube.v;
            double across = x * tube.normal_u + y * tube.normal_v, along = x * tube.tangent_u + y * tube.tangent_v;
            double low = std::min(std::max((across - half) / tube.half_width, -1.0), 1.0);
            double high = std::min(std::max((across + half) / tube.half_width, -1.0), 1.0);
            double present = 1.0;
            if (at == 0) present = std::min(std::max(0.5 + along * divisions, 0.0), 1.0);
            if (at == curve.shape[0] - 1) present *= std::min(std::max(0.5 - along * divisions, 0.0), 1.0);
            if (!(present > 0.0 && high > low)) continue;
            double scale = present * tube.half_width * divisions;
            coverage[j] = (high - low) * scale;
            shade[j] = (summed_shading(high, asymmetry) - summed_shading(low, asymmetry)) * scale;
        }
        ++k;
    }
    return found;
}

}  // namespace vbaa::simulate
