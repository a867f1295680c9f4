// Noise of whole rows, from the common offset of a row's blocks.
#include "detect/row_noise.hpp"

#include "order.hpp"

namespace vbaa::detect {
namespace {

constexpr int BLOCKS = 16;   // in which a row's pixels are averaged: many, and each of many pixels
constexpr int PER_ROW = 32;  // cells in which points are counted

// Exact, of a block's pixels.
template <class T>
using Sum = std::conditional_t<sizeof(T) == 1, std::uint32_t, double>;

template <class T>
double sum_of(const T* values, int count) {
    Sum<T> sum = {};
    for (int i = 0; i < count; ++i) sum += values[i];
    return static_cast<double>(sum);
}

// (rows, BLOCKS) means of the blocks of rows, or columns, from `first` on.
template <class T>
Table block_means(Levels<T> picture, int axis, int first, int rows) {
    const int across = picture.shape[axis], channels = picture.shape[2];
    Table means(rows, BLOCKS);
    std::vector<Sum<T>> sums(rows * channels);
    for (int b = 0; b < BLOCKS; ++b) {
        const int from = b * across / BLOCKS, to = (b + 1) * across / BLOCKS;
        const double share = 1.0 / (std::max(to - from, 1) * channels);
        std::fill(sums.begin(), sums.end(), Sum<T>{});
        for (int other = from; axis == 0 && other < to; ++other) {
            const T* const own = &picture(other, first, 0);
            for (int i = 0; i < rows * channels; ++i) sums[i] += own[i];
        }
        for (int n = 0; n < rows; ++n)
            means(n, b) = share * (axis ? sum_of(&picture(first + n, from, 0), (to - from) * channels)
                                        : sum_of(&sums[n * channels], channels));
    }
    return means;
}

// Standard deviation of the rows' common offsets, by second differences of neighbouring rows: only a common offset
// gives products of different blocks a positive mean. The median over rows leaves out the few in which an edge runs
// along them.
double shared_std(const Table& means) {
    const int rows = means.shape[0] - 2;
    if (rows < 1) return 0.0;
    const double products = median(each(rows, [&](int n) {
        double sum = 0.0, squares = 0.0;
        for (int b = 0; b < BLOCKS; ++b) {
            const double bend = means(n + 1, b) - 0.5 * (means(n, b) + means(n + 2, b));
            sum += bend;
            squares += bend * bend;
        }
        return (sum * sum - squares) / (BLOCKS * (BLOCKS - 1));
    }));
    return MAD_SCALE * std::sqrt(std::max(products, 0.0) / 1.5);
}

}  // namespace

RowNoise row_noise(const Picture& picture, ConstMatrix points, int axis, int band, int least) {
    const int count = points.shape[0];
    RowNoise found = {Numbers(count)};
    double lowest = INFINITY, highest = -INFINITY, nearest = INFINITY;
    for (int n = 0; n < count; ++n) {
        lowest = std::min(lowest, points(n, axis));
        highest = std::max(highest, points(n, axis));
        if (n >= least) nearest = std::min(nearest, std::abs(points(n, axis) - points(n - least, axis)));
    }
    if (nearest > 1.0) return found;  // it crosses the rows
    const auto cell = [&](double place) { return static_cast<int>(std::lrint(PER_ROW * (place - lowest))); };
    const int cells = cell(highest) + 1;
    std::vector<int> below(cells + 1);  // points before each cell
    for (int n = 0; n < count; ++n) ++below[cell(points(n, axis)) + 1];
    for (int c = 0; c < cells; ++c) below[c + 1] += below[c];
    found.alike = each(count, [&](int n) {
        const int own = cell(points(n, axis));
        return static_cast<double>(below[std::min(own + PER_ROW / 2, cells)] - below[std::max(own - PER_ROW / 2, 0)]);
    });
    if (*std::max_element(found.alike.begin(), found.alike.end()) < least) return found;
    std::visit(
        [&](auto levels) {
            const int first = std::max(static_cast<int>(lowest) - band, 0);
            const int last = std::min(static_cast<int>(highest) + band + 1, levels.shape[1 - axis]);
            found.std = shared_std(block_means(levels, axis, first, std::max(last - first, 0)));
        },
        picture);
    return found;
}

}  // namespace vbaa::detect
