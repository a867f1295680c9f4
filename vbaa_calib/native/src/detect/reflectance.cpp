// Reflectance across a silhouette, learned together with its width, blur, taper and course.
#include "detect/reflectance.hpp"

#include "polyline.hpp"

namespace vbaa::detect {

namespace {

constexpr int K = POLYNOMIALS;
constexpr int EDGES = 16;        // places across a line at which an edge is tried in its place
constexpr int EDGE_PX = 12;      // so far from an edge nothing of its blur is left
constexpr double FAR_STD = 8.0;  // standard deviations beyond the silhouette's edge at which nothing is left of it
constexpr double STEP = 0.02;    // of width and blur, as a part of them, for the derivatives
constexpr double POWERS[K][K] = {{1.0}, {0.0, 1.0}, {-0.5, 0.0, 1.5}, {0.0, -1.5, 0.0, 2.5}};
using Coefficients = std::array<double, K>;
using Equations = Array<double, 3>;   // (N, M, M) a profile each
using Shape = std::array<double, 3>;  // logarithms of width and blur over the initial ones; taper

// Prior deviations of the coefficients over the antenna's contrast: level, brighter on one side, a highlight, and that
// on one side; of width and blur, logarithmic, and of the taper.
constexpr Coefficients LIKELY = {3.0, 0.8, 0.8, 0.5};
constexpr Shape SHAPE_STD = {0.03, 0.3, TAPER_STD};
constexpr double LEAST_LIKELY = 0.22;     // where a line shows nothing of them they shrink to this part
constexpr double LIKELY_PROFILES = 10.0;  // so many profiles count for the prior deviations
constexpr double WINDOW_PX = 21.0;        // over so much of its length the antenna looks alike
constexpr int LEARNING = 48;              // at least so many profiles are learned from at first
constexpr int PASSES = 4;
// What the shape cannot follow is alike in many neighbours. A whole line counts as so many profiles for where it is;
// once that is about right, as so many; and for its width and blur each profile as one part in so many.
constexpr double INDEPENDENT = 8.0, WELL_BEGUN = 60.0, ALIKE = 30.0;
constexpr double START_STEP_PX = 0.5;    // steps of the first search for the line
constexpr int START_BENDS = 9;           // places tried at either end and in the middle
constexpr int START_PROFILES = 24;       // profiles that these are tried on
constexpr double MISFIT = 0.01;          // part of the profiles' power that no shape follows
constexpr double PULLED = 0.01;          // part of the width by which the line may be pulled in any case
constexpr double PULLED_LOPSIDED = 0.1;  // and by a reflectance that is lopsided by the line's whole height
constexpr double LEFT = 0.42;            // part of the initial course's deviation that is left afterwards
// Where a line does not explain the profiles near by better than one edge, an object's or a shadow's, by so much,
// squares over the noise's, it may lie off by up to this part of its width.
constexpr double OVER_EDGE = 20.0, UNSURE = 0.17;
constexpr int STIFF_PIECES = 4, PIECES = 10;  // of the smooth initial path, and of the line's course about it

double mean_square(ConstVector coefficients) {
    double sum = 0.0;
    for (int k = 0; k < K; ++k) sum += square(coefficients[k]) * MEAN_SQUARE[k];
    return sum;
}

// Contrast of most profiles, grey levels, of whatever there is in them.
double first_contrast(const Crossings& found, double width_px) {
    Table grey(found.profiles);
    remove_background(grey);
    const Numbers power = each(grey.shape[0], [&](int n) { return dot(grey.row(n), grey.row(n)) / width_px; });
    return std::sqrt(quantile(selected(power, found.inside), 0.7)) + 1e-6;
}

// Normal equations summed over `near` neighbours.
Equations with_neighbours(Equations equations, int near) {
    const auto [count, size, _] = equations.shape;
    Table sums = triangle_sums(ConstMatrix(equations.begin(), {count, size * size}), near);
    equations.values = std::move(sums.values);
    return equations;
}

// The same of weighted equations, with the prior of the coefficients and, if it is among the unknowns, of the place.
Equations with_neighbours(Equations equations, ConstVector weight, int near, const Coefficients& likely,
                          double contrast) {
    const auto [count, size, _] = equations.shape;
    for (int n = 0; n < count; ++n)
        for (double& product : equations.row(n)) product *= weight[n];
    Equations local = with_neighbours(std::move(equations), near);
    for (int n = 0; n < count; ++n) {
        for (int k = 0; k < K; ++k) local(n, k, k) += 1.0 / square(likely[k] * contrast);
        if (size > PLACE) local(n, PLACE, PLACE) += 1.0 / square(START_STEP_PX);
    }
    return local;
}

// Coefficients that the first rows of equations (M, M) give for a right side that is one of its columns, and what they
// explain of it: the sum of their products with it.
double solved_coefficients(ConstMatrix equations, int column, const Coefficients& ridge, Vector coefficients) {
    std::array<double, K * K> matrix;
    for (int i = 0; i < K; ++i) {
        coefficients[i] = equations(i, column);
        for (int j = 0; j < K; ++j) matrix[i * K + j] = equations(i, j) + (i == j ? ridge[i] : 0.0);
    }
    solve_definite(Matrix(matrix.data(), {K, K}), Matrix(coefficients.data, {K, 1}));
    double explained = 0.0;
    for (int k = 0; k < K; ++k) explained += coefficients[k] * equations(k, column);
    return explained;
}

// A smooth course along the profiles, (N,), and its deviation, (N,), px.
struct Course {
    Numbers mean, std;
};

// The mean of smooth courses, weighted by how little they leave (N, O) at offsets (O,).
Course mean_course(const Numbers& share, const Flags& inside, const Numbers& offsets, const Table& left,
                   double sharpness) {
    const int count = share.size(), last = offsets.size() - 1, courses = START_BENDS * START_BENDS * START_BENDS;
    Table shapes(count, 3), tried(courses, 3);
    for (int n = 0; n < count; ++n) {
        shapes(n, 0) = (1.0 - share[n]) * (1.0 - 2.0 * share[n]);
        shapes(n, 1) = 4.0 * share[n] * (1.0 - share[n]);
        shapes(n, 2) = share[n] * (2.0 * share[n] - 1.0);
    }
    const auto bend = [&](int step) {
        return offsets[0] + (offsets[last] - offsets[0]) / (START_BENDS - 1) * (step % START_BENDS);
    };
    const int step = std::max(1, count / START_PROFILES), used = (count + step - 1) / step;
    Numbers weight(courses);
    for (int c = 0; c < courses; ++c) {
        const Vector course = tried.row(c);
        course[0] = bend(c / (START_BENDS * START_BENDS)), course[1] = bend(c / START_BENDS), course[2] = bend(c);
        for (int n = 0; n < count; n += step) {
            if (!inside[n]) continue;
            const double off = shapes(n, 0) * course[0] + shapes(n, 1) * course[1] + shapes(n, 2) * course[2];
            const double place = bounded((off - offsets[0]) / START_STEP_PX, 0.0, last - 0.001);
            const int row = static_cast<int>(place);
            weight[c] += left(n, row) + (left(n, row + 1) - left(n, row)) * (place - row);
        }
    }
    const double least = *std::min_element(weight.begin(), weight.end());
    for (double& each : weight) each = std::exp(-sharpness * (each - least) / used);
    const double whole = total(weight);
    Shape mean = {};
    double spread[3][3] = {};
    for (int c = 0; c < courses; ++c)
        for (int i = 0; i < 3; ++i) mean[i] += weight[c] / whole * tried(c, i);
    for (int c = 0; c < courses; ++c)
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                spread[i][j] += weight[c] / whole * (tried(c, i) - mean[i]) * (tried(c, j) - mean[j]);
    Course course = {Numbers(count), Numbers(count)};
    for (int n = 0; n < count; ++n) {
        double variance = 0.0;
        for (int i = 0; i < 3; ++i) {
            course.mean[n] += shapes(n, i) * mean[i];
            for (int j = 0; j < 3; ++j) variance += shapes(n, i) * spread[i][j] * shapes(n, j);
        }
        course.std[n] = std::sqrt(std::max(variance, 0.0));
    }
    return course;
}

// Where across the path a silhouette of this width, whatever is on it, explains most. The mean over all smooth courses,
// for between a highlight's sides many explain as much.
Course initial_course(const Crossings& found, const Silhouette& silhouette, int near) {
    const int count = found.along.size(), length = found.profiles.shape[1];
    const int steps = std::max(1, static_cast<int>(std::ceil(0.6 * silhouette.width_px / START_STEP_PX)));
    const Numbers offsets = each(2 * steps + 1, [&](int o) { return START_STEP_PX * (o - steps); });
    const Table values = blurred_polynomials(silhouette, length / 2 + 2);
    Coefficients ridge, coefficients;
    for (int k = 0; k < K; ++k) ridge[k] = 0.01 / square(LIKELY[k]);
    Table left(count, offsets.size());
    for (int o = 0; o < offsets.size(); ++o) {
        const Numbers base = each(count, [&](int) { return offsets[o]; });
        const Equations local = with_neighbours(coefficient_equations(found, base, values), near);
        for (int n = 0; n < count; ++n) {
            const double power = local(n, K, K);
            const double explained = solved_coefficients(local.row(n), K, ridge, Vector(coefficients.data(), {K}));
            left(n, o) = std::log(std::max(power - explained, 0.0) + MISFIT * power + 1e-9);
        }
    }
    return mean_course(shares(found), found.inside, offsets, left, 0.5 * length * INDEPENDENT);
}

// Step of width, blur and taper, for any coefficients and place: these are eliminated from every profile's equations.
Shape shape_step(const Equations& local, const Shape& moved, int near) {
    Table matrix(3, 3), side(3, 1), left(K + 1, K + 1), right(K + 1, 4);
    const auto unknown = [](int k) { return k == K ? PLACE : k; };
    const auto kept = [](int j) { return j < 3 ? SHAPE + j : LEVELS; };
    for (int i = 0; i < 3; ++i) {
        matrix(i, i) = 1.0 / square(SHAPE_STD[i]);
        side(i, 0) = -moved[i] / square(SHAPE_STD[i]);
    }
    for (int n = 0; n < local.shape[0]; ++n) {
        for (int i = 0; i < K + 1; ++i) {
            for (int j = 0; j < K + 1; ++j) left(i, j) = local(n, unknown(i), unknown(j));
            for (int j = 0; j < 4; ++j) right(i, j) = local(n, unknown(i), kept(j));
        }
        solve_definite(left, right);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 4; ++j) {
                double rest = local(n, kept(i), kept(j));
                for (int k = 0; k < K + 1; ++k) rest -= local(n, kept(i), unknown(k)) * right(k, j);
                (j < 3 ? matrix(i, j) : side(i, 0)) += rest / (near * ALIKE);
            }
    }
    solve_definite(matrix, side);
    Shape step;
    for (int i = 0; i < 3; ++i) step[i] = std::min(std::max(side(i, 0), -0.3), 0.3);
    return step;
}

// Solutions of N normal equations after a step of the shape.
struct Solved {
    Table free;      // (N, K) coefficients where the line is assumed
    Table toward;    // (N, K) how they change with its place
    Table variance;  // (N, K) of the coefficients
    Numbers known;   // (N,) information on the place
    Numbers shift;   // (N,) how far off it is
};

Solved solved(const Equations& local, const Shape& step) {
    const int count = local.shape[0];
    Solved found = {Table(count, K), Table(count, K), Table(count, K), Numbers(count), Numbers(count)};
    Table matrix(K, K), right(K, K + 2);
    std::array<double, COLUMNS> side;
    for (int n = 0; n < count; ++n) {
        const ConstMatrix own = local.row(n);
        for (int i = 0; i < COLUMNS; ++i) {
            side[i] = own(i, LEVELS);
            for (int j = 0; j < 3; ++j) side[i] -= own(i, SHAPE + j) * step[j];
        }
        for (int i = 0; i < K; ++i) {
            for (int j = 0; j < K; ++j) matrix(i, j) = own(i, j), right(i, j) = i == j;
            right(i, K) = side[i], right(i, K + 1) = own(i, PLACE);
        }
        solve_definite(matrix, right);
        double known = own(PLACE, PLACE), shift = side[PLACE];
        for (int k = 0; k < K; ++k) {
            found.variance(n, k) = right(k, k);
            found.free(n, k) = right(k, K);
            found.toward(n, k) = right(k, K + 1);
            known -= right(k, K + 1) * own(k, PLACE);
            shift -= right(k, K + 1) * side[k];
        }
        found.known[n] = known;
        found.shift[n] = shift / known;
    }
    return found;
}

// (N,) what coefficients (N, K), a step of the shape and moves (N,) of the place leave: roots of squares.
Numbers left_over(const Equations& equations, const Table& coefficients, const Shape& step, ConstVector moves) {
    return each(equations.shape[0], [&](int n) {
        std::array<double, COLUMNS> parts;
        for (int k = 0; k < K; ++k) parts[k] = -coefficients(n, k);
        for (int i = 0; i < 3; ++i) parts[SHAPE + i] = -step[i];
        parts[PLACE] = -moves[n], parts[LEVELS] = 1.0;
        double sum = 0.0;
        for (int i = 0; i < COLUMNS; ++i)
            for (int j = 0; j < COLUMNS; ++j) sum += parts[i] * equations(n, i, j) * parts[j];
        return std::sqrt(std::max(sum, 0.0));
    });
}

// Deviations of the coefficients (N, K), over the contrast, as this line shows them; `variance` (N, K) of these.
Coefficients likely_here(const Table& coefficients, const Table& variance, double contrast, const Coefficients& likely,
                         ConstVector weight) {
    Coefficients fresh = LIKELY;
    for (int k = 1; k < K; ++k) {
        double known = LIKELY_PROFILES, sum = LIKELY_PROFILES * square(LEAST_LIKELY * LIKELY[k]);
        for (int n = 0; n < weight.shape[0]; ++n) {
            known += weight[n] * std::max(1.0 - variance(n, k) / square(contrast * likely[k]), 0.0);
            sum += weight[n] * square(coefficients(n, k) / contrast);
        }
        fresh[k] = std::min(std::sqrt(sum / known), 2.0 * LIKELY[k]);
    }
    return fresh;
}

// What is learned from every `step`th of the profiles: the line's course about them, and the reflectance at each.
struct Learning {
    Crossings some;
    Silhouette initial;
    int near;            // neighbours over which the antenna looks alike
    double per_profile;  // how much a profile counts for the place
    Numbers share;
    Course prior;
    Numbers looseness;  // information of the prior course
    // what is improved
    Silhouette silhouette;
    Shape moved = {};
    double contrast, noise;
    Coefficients likely = LIKELY;
    Numbers course, weight;
    Table coefficients;

    double taper() const { return bounded(moved[2], -MAX_TAPER, MAX_TAPER); }
};

// (N,) the course moved to where the profiles see the line, as far as it is smooth and agrees with its prior.
Numbers improved_course(const Learning& now, const Solved& found) {
    const int count = now.course.size();
    Numbers target(count), trust(count);
    for (int n = 0; n < count; ++n) {
        const double known = now.weight[n] * found.known[n] * now.per_profile, loose = now.looseness[n];
        const double here = now.course[n] + std::min(std::max(found.shift[n], -1.0), 1.0);
        trust[n] = known + loose;
        target[n] = (known * here + loose * now.prior.mean[n]) / trust[n];
    }
    return fit_smooth(now.share, target, trust, {1.0, 0.5}, PIECES, 1e-3).values;
}

// One pass: coefficients, and after the first pass the shape and the course, from equations at the present ones.
void improve(Learning& now, bool first) {
    const int count = now.course.size(), length = now.some.profiles.shape[1];
    const Equations equations = normal_equations(tapered(now.some, {now.taper()}), now.course, now.silhouette,
                                                 now.coefficients, length / 2 + 2);
    const Numbers over_noise = each(count, [&](int n) { return now.weight[n] / square(now.noise); });
    const Equations local = with_neighbours(equations, over_noise, now.near, now.likely, now.contrast);
    const Shape change = first ? Shape{} : shape_step(local, now.moved, now.near);
    for (int i = 0; i < 3; ++i) now.moved[i] += change[i];
    const Solved found = solved(local, change);
    Numbers moves(count);
    if (!first) {
        Numbers better = improved_course(now, found);
        for (int n = 0; n < count; ++n) moves[n] = better[n] - now.course[n];
        now.course = std::move(better);
    }
    for (int n = 0; n < count; ++n)
        for (int k = 0; k < K; ++k) now.coefficients(n, k) = found.free(n, k) - found.toward(n, k) * moves[n];
    Numbers rms = left_over(equations, now.coefficients, change, moves);
    for (double& each : rms) each /= std::sqrt(length - 4.0);
    now.noise = std::max(quantile(selected(rms, now.some.inside), QUIET), 1e-3 * now.contrast);
    double whole = 0.0, power = 0.0;
    for (int n = 0; n < count; ++n) {
        now.weight[n] = now.some.inside[n] / (1.0 + square(rms[n] / (3.0 * now.noise)));
        whole += now.weight[n];
        power += now.weight[n] * mean_square(now.coefficients.row(n));
    }
    now.contrast = std::sqrt(power / std::max(whole, 1e-9)) + 1e-6;
    if (!first) now.likely = likely_here(now.coefficients, found.variance, now.contrast, now.likely, now.weight);
    now.silhouette = {now.initial.width_px * std::exp(now.moved[0]), now.initial.blur_px * std::exp(now.moved[1])};
}

Learning learned_from_some(const Crossings& found, int step, const Silhouette& initial, const KnownCourse& known) {
    Learning now;
    now.some = every(found, step);
    const int count = now.some.along.size(), last = found.along.size() - 1;
    now.initial = now.silhouette = initial;
    now.near = std::max(3, static_cast<int>(std::rint(0.5 * WINDOW_PX / step)));
    now.per_profile = WELL_BEGUN / (last + 1);
    now.share = each(count, [&](int n) { return now.some.along[n] / std::max(found.along[last], 1e-6); });
    const bool begun = known.course.size() > 0;
    if (begun) {
        now.prior.mean = each(count, [&](int n) { return known.course[n * step]; });
        now.prior.std = each(count, [&](int) { return known.std_px; });
    } else {
        now.prior = initial_course(now.some, initial, now.near);
    }
    now.looseness =
        each(count, [&](int n) { return 1.0 / square(std::max(now.prior.std[n], begun ? 0.0 : START_STEP_PX)); });
    now.contrast = first_contrast(now.some, initial.width_px);
    now.noise = 0.1 * now.contrast;
    now.course = now.prior.mean;
    now.weight = each(count, [&](int n) { return now.some.inside[n] ? 1.0 : 0.0; });
    now.coefficients = Table(count, K);
    for (int pass = 0; pass < PASSES; ++pass) improve(now, pass == 0);
    return now;
}

// (K,) of the table's columns, or their sum weighted by coefficients (K,).
double between(const Table& table, Place at, int k) {
    const double* const near = table.begin() + at.row * K + k;
    return near[0] + at.far * (near[K] - near[0]);
}

double weighted(const Table& table, Place at, const double* coefficients) {
    double sum = 0.0;
    for (int k = 0; k < K; ++k) sum += coefficients[k] * between(table, at, k);
    return sum;
}

// (N, M, M) sums over pixels of the products of every profile's columns, less level and slope of the background. The
// last column are the grey levels; `fill` sets the others, of profile n at pixel t and its place in tables up to row
// `last`.
template <class Fill>
Array<double, 3> products(const Crossings& found, ConstVector base, int last, int several, Fill fill) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1];
    Array<double, 3> sums(count, several, several);
    Table columns(several, length);
    Numbers across(length);
    for (int n = 0; n < count; ++n) {
        distances(found, n, base[n], across);
        for (int t = 0; t < length; ++t) fill(n, t, Place(across[t], last), columns);
        copy(found.profiles.row(n), columns.row(several - 1));
        remove_background(columns);
        for (int i = 0; i < several; ++i)
            for (int j = 0; j <= i; ++j) sums(n, i, j) = sums(n, j, i) = dot(columns.row(i), columns.row(j));
    }
    return sums;
}

// (R, K) derivative of the blurred polynomials by the logarithm of what one silhouette has more of than another.
Table derivative(const Silhouette& more, const Table& values, int reach_px) {
    Table changed = blurred_polynomials(more, reach_px);
    for (int i = 0; i < values.size(); ++i) changed.values[i] = (changed.values[i] - values.values[i]) / STEP;
    return changed;
}

}  // namespace

// By the recurrence of the powers' convolution with a bell over an interval. Odd ones change sign in the middle.
Table blurred_polynomials(const Silhouette& silhouette, int reach_px) {
    const double half = 0.5 * silhouette.width_px, variance = square(silhouette.blur_px) + square(PIXEL_BLUR_PX);
    const double std = std::sqrt(variance), height = 1.0 / (std::sqrt(2.0 * M_PI) * std);
    const int middle = reach_px * PER_PX;
    Table values(2 * middle + 1, K);
    std::array<double, K> powers, halves;
    for (int k = 0; k < K; ++k) halves[k] = k ? halves[k - 1] * half : 1.0;
    for (int r = 0; r <= middle; ++r) {
        const double across = static_cast<double>(r) / PER_PX, left = (across + half) / std;
        const double right = (across - half) / std;
        if (right > FAR_STD) break;
        const double rising = height * std::exp(-0.5 * left * left), falling = height * std::exp(-0.5 * right * right);
        powers[0] = 0.5 * (std::erfc(-left / std::sqrt(2.0)) - std::erfc(-right / std::sqrt(2.0)));
        for (int k = 0; k < K - 1; ++k) {
            const double before = k ? k * powers[k - 1] : 0.0;
            const double ends = halves[k] * (k % 2 ? falling + rising : falling - rising);
            powers[k + 1] = across * powers[k] + variance * (before - ends);
        }
        for (int k = 0; k < K; ++k) {
            double value = 0.0;
            for (int i = 0; i <= k; ++i) value += POWERS[k][i] * powers[i] / halves[i];
            values(middle + r, k) = value;
            values(middle - r, k) = k % 2 ? -value : value;
        }
    }
    return values;
}

Array<double, 3> normal_equations(const Crossings& found, ConstVector base, const Silhouette& silhouette,
                                  ConstMatrix coefficients, int reach_px) {
    const auto [width_px, blur_px] = silhouette;
    const Table values = blurred_polynomials(silhouette, reach_px), slopes = slopes_of(values);
    const Table wider = derivative({width_px * (1.0 + STEP), blur_px}, values, reach_px);
    const Table softer = derivative({width_px, blur_px * (1.0 + STEP)}, values, reach_px);
    const Numbers share = shares(found);
    Array<double, 3> sums =
        products(found, base, values.shape[0] - 1, COLUMNS, [&](int n, int t, Place at, Table& columns) {
            const double* const own = coefficients.row(n).data;
            for (int k = 0; k < K; ++k) columns(k, t) = between(values, at, k);
            columns(SHAPE, t) = weighted(wider, at, own);
            columns(SHAPE + 1, t) = weighted(softer, at, own);
            columns(SHAPE + 2, t) = columns(SHAPE, t) * (share[n] - 0.5);
            columns(PLACE, t) = weighted(slopes, at, own) * -found.side[n] / found.stretch[n];
        });
    for (int n = 0; n < found.inside.size(); ++n)
        if (!found.inside[n]) fill(sums.row(n), 0.0);
    return sums;
}

Array<double, 3> coefficient_equations(const Crossings& found, ConstVector base, const Table& values) {
    return products(found, base, values.shape[0] - 1, K + 1, [&](int, int t, Place at, Table& columns) {
        for (int k = 0; k < K; ++k) columns(k, t) = between(values, at, k);
    });
}

Numbers explained_by_edges(const Crossings& found, ConstVector base, const Silhouette& silhouette, ConstVector weight,
                           int near) {
    const int count = found.profiles.shape[0], length = found.profiles.shape[1], last = EDGE_PX * PER_PX;
    const double spread = PER_PX * std::sqrt(2.0 * (square(silhouette.blur_px) + square(PIXEL_BLUR_PX)));
    const Numbers table = each(2 * last + 1, [&](int r) { return 0.5 * std::erfc((last - r) / spread); });
    Table sums(count, 2 * EDGES), rows(EDGES + 1, length);  // an edge's square, and its product with the grey levels
    Numbers across(length);
    for (int n = 0; n < count; ++n) {
        distances(found, n, base[n], across);
        copy(found.profiles.row(n), rows.row(EDGES));
        for (int e = 0; e < EDGES; ++e) {
            const double place = (silhouette.width_px + 2.0) * (e / (EDGES - 1.0) - 0.5);
            for (int t = 0; t < length; ++t) {
                const double row = std::rint((across[t] - place) * PER_PX) + last;
                rows(e, t) = table[static_cast<int>(bounded(row, 0.0, 2 * last))];
            }
        }
        remove_background(rows);
        for (int e = 0; e < EDGES; ++e) {
            sums(n, 2 * e) = weight[n] * dot(rows.row(e), rows.row(e));
            sums(n, 2 * e + 1) = weight[n] * dot(rows.row(e), rows.row(EDGES));
        }
    }
    sums = triangle_sums(sums, near);
    return each(count, [&](int n) {
        double most = 0.0;
        for (int e = 0; e < EDGES; ++e)
            most = std::max(most, square(sums(n, 2 * e + 1)) / std::max(sums(n, 2 * e), 1e-9));
        return most;
    });
}

Table stiffened(ConstMatrix path_px) {
    const int count = path_px.shape[0];
    const Numbers along = arc_lengths(path_px);
    const double whole = std::max(along[count - 1], 1e-6);
    const Numbers share = each(count, [&](int k) { return along[k] / whole; });
    const Numbers weights = each(count, [](int) { return 1.0; });
    Table path(count, 2);
    for (int axis = 0; axis < 2; ++axis) {
        const Numbers values = each(count, [&](int k) { return path_px(k, axis); });
        const SmoothCurve curve = fit_smooth(share, values, weights, {1.0, 0.5}, STIFF_PIECES, 1e-6);
        for (int k = 0; k < count; ++k) path(k, axis) = curve.values[k];
    }
    return path;
}

CrossSection mean_shape(const Reflectance& reflectance, const std::vector<int>& which) {
    std::array<double, K> mean = {};
    for (int n : which)
        for (int k = 0; k < K; ++k) mean[k] += reflectance.coefficients(n, k) / static_cast<double>(which.size());
    const ConstVector coefficients(mean.data(), {K});
    const double height = std::sqrt(std::max(mean_square(coefficients), 1e-12));
    for (double& each : mean) each /= height;
    return {product(reflectance.section.values, coefficients), product(reflectance.section.slopes, coefficients), {}};
}

LearnedReflectance learn_reflectance(const Crossings& found, const Silhouette& initial, const KnownCourse& known) {
    const int count = found.along.size(), step = std::max(1, count / LEARNING);
    const Learning part = learned_from_some(found, step, initial, known);
    const auto all_along = [&](const Numbers& values) {
        return each(count, [&](int n) { return interpolated(part.some.along, values, found.along[n]); });
    };
    Numbers weight = all_along(part.weight), course = all_along(part.course);
    for (int n = 0; n < count; ++n) weight[n] *= found.inside[n] / square(part.noise);
    const Crossings broadening = tapered(found, {part.taper()});
    const int near = static_cast<int>(std::rint(0.5 * WINDOW_PX));
    CrossSection section;
    section.values = blurred_polynomials(part.silhouette, found.profiles.shape[1] / 2 + 2);
    section.slopes = slopes_of(section.values);
    const Equations local = with_neighbours(coefficient_equations(broadening, course, section.values), weight, near,
                                            part.likely, part.contrast);
    // where the course is known, an antenna of known polarity was found there
    Numbers over_edge = known.course.size() ? each(count, [](int) { return -HUGE_VAL; })
                                            : explained_by_edges(broadening, course, part.silhouette, weight, near);
    Table coefficients(count, K);
    for (int n = 0; n < count; ++n)
        over_edge[n] = solved_coefficients(local.row(n), K, {}, coefficients.row(n)) - over_edge[n];
    LearnedReflectance learned;
    learned.sure = each(count, [&](int n) { return std::min(std::max(over_edge[n] / OVER_EDGE, 0.0), 1.0); });
    // before and beyond all that is clear there is none where the edge explains more
    learned.none = each(count, [&](int n) { return over_edge[n] < 0.0; });
    const std::vector<int> clear = places(each(count, [&](int n) { return over_edge[n] > OVER_EDGE; }));
    if (!clear.empty()) std::fill(learned.none.begin() + clear.front(), learned.none.begin() + clear.back(), false);
    const Numbers shared = all_along(part.prior.std);
    Numbers height(count);
    learned.shared_px = Numbers(count);
    section.weights = Table(count, K);
    for (int n = 0; n < count; ++n) {
        const ConstVector own = coefficients.row(n);
        height[n] = std::sqrt(std::max(mean_square(own), 1e-12));
        const double lop = std::sqrt(square(own[1]) * MEAN_SQUARE[1] + square(own[3]) * MEAN_SQUARE[3]) / height[n];
        const double pulled = initial.width_px * std::hypot(PULLED, PULLED_LOPSIDED * lop);
        const double unsure = UNSURE * initial.width_px * (1.0 - learned.sure[n]);
        learned.shared_px[n] =
            std::sqrt(square(LEFT * shared[n]) + square(pulled) + square(unsure)) / broadening.stretch[n];
        for (int k = 0; k < K; ++k) section.weights(n, k) = own[k] / height[n];
    }
    learned.reflectance = {part.silhouette, std::move(coefficients), std::move(height), std::move(section)};
    learned.course = std::move(course);
    learned.taper = part.taper();
    return learned;
}

}  // namespace vbaa::detect
