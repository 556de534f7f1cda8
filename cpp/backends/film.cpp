// Films, on either machine.
#include <algorithm>
#include <cmath>
#include <limits>

#include "backends/film_memory.h"
#include "backends/spare.h"

namespace veriray {
namespace {

std::string in_words(const PlaneInfo& p) {
    return "'" + p.name + "' (" + kPlaneKinds[static_cast<uint32_t>(p.kind)] + ", " +
           std::to_string(p.channels) + " channels, " + (p.negative ? "" : "not ") + "negative)";
}

uint32_t words_of(const PlaneInfo& p) {
    return p.channels * kPlaneWords[static_cast<uint32_t>(p.kind)];
}

void check_size(uint32_t width, uint32_t height) {
    if (width == 0 || height == 0 || static_cast<uint64_t>(width) * height >= 1ull << 31)
        fail("a film of " + std::to_string(width) + " x " + std::to_string(height) +
             " pixels; allowed: 1 to 2^31 - 1");
}

void check_channels(uint32_t channels, const std::string& of) {
    if (channels == 0 || channels > 64) fail(of + "; allowed: 1 to 64 channels");
}

void check_planes(const std::vector<PlaneInfo>& planes) {
    constexpr size_t kMostPlanes = 64;
    if (planes.size() > kMostPlanes)
        fail("a film of " + std::to_string(planes.size()) + " planes; allowed: 1 to 64");
    for (size_t i = 0; i < planes.size(); ++i) {
        if (planes[i].name.empty()) fail("a plane without a name");
        for (size_t k = 0; k < i; ++k)
            if (planes[k].name == planes[i].name) fail("two planes '" + planes[i].name + "'");
        check_channels(planes[i].channels, "plane " + in_words(planes[i]));
    }
}

// Whether a plane can have the scale: 0, of sums also a power of two.
bool is_scale(const PlaneInfo& p, float scale) {
    int exponent;
    return scale == 0 || (p.kind != PlaneKind::kIntegers && scale >= 0x1p-100f &&
                          scale <= 0x1p100f && std::frexp(scale, &exponent) == 0.5f);
}

}  // namespace

PlaneView Film::Impl::plane(const std::string& name, float scale) {
    size_t i = 0;
    while (i < planes.size() && planes[i].name != name) ++i;
    if (i == planes.size()) fail("the film has no plane '" + name + "'");
    const PlaneInfo& p = planes[i];
    if (!is_scale(p, scale) || (scale == 0) != (p.kind == PlaneKind::kIntegers))
        fail("a sample's scale = " + std::to_string(scale) + " for plane " + in_words(p) +
             "; allowed: a power of two from 2^-100 to 2^100, for integers 0");
    match_scale(i, scale);
    return {memory->words() + first[i], p.channels, p.kind == PlaneKind::kSumsAndSquares,
            p.negative, scale};
}

void Film::Impl::check_scale(size_t plane, float scale) const {
    if (scale == 0 || scales[plane] == 0 || scale == scales[plane]) return;
    fail(plane ? "plane '" + planes[plane].name + "' of the film holds samples of another scale"
               : "the film holds samples of a scene of another brightness");
}

void Film::Impl::with_more(uint64_t n) const {
    if (n > ~0ull - samples)
        fail(std::to_string(n) + " samples more than the film's " + std::to_string(samples) +
             "; allowed: 2^64 - 1 in all");
}

Film::Film(uint32_t width, uint32_t height, int device, const std::vector<PlaneInfo>& more)
    : impl(std::make_unique<Impl>()) {
    check_size(width, height);
    impl->width = width, impl->height = height, impl->device = device;
    impl->planes = {{"radiance", PlaneKind::kSumsAndSquares, 3, false}};
    impl->planes.insert(impl->planes.end(), more.begin(), more.end());
    check_planes(impl->planes);
    impl->scales.resize(impl->planes.size());
    impl->first = {0};
    for (const PlaneInfo& p : impl->planes)
        impl->first.push_back(impl->first.back() +
                              static_cast<size_t>(width) * height * words_of(p));
    impl->memory = film_memory(impl->first.back(), device);
}
Film::~Film() = default;
uint32_t Film::width() const { return impl->width; }
uint32_t Film::height() const { return impl->height; }
uint64_t Film::samples() const { return impl->samples; }
uint64_t Film::units() const { return impl->units; }
size_t Film::memory() const { return impl->first.back() * sizeof(uint64_t); }
const std::vector<PlaneInfo>& Film::planes() const { return impl->planes; }
float Film::scale(size_t plane) const { return impl->scales[plane]; }
void Film::clear() {
    impl->memory->clear();
    impl->samples = impl->units = 0;
    std::fill(impl->scales.begin(), impl->scales.end(), 0.f);
}

void Film::add(const Film& other) {
    if (other.width() != width() || other.height() != height())
        fail("films of different sizes cannot be added");
    if (other.planes() != planes()) fail("films of different planes cannot be added");
    impl->with_more(other.samples());
    for (size_t i = 0; i < planes().size(); ++i) impl->check_scale(i, other.scale(i));
    impl->memory->add(*other.impl->memory);
    for (size_t i = 0; i < planes().size(); ++i) impl->match_scale(i, other.scale(i));
    impl->samples += other.samples();
    impl->units += other.units();
}

void Film::add(uint64_t samples, uint64_t units, const std::vector<PlaneState>& state) {
    if (state.size() != planes().size())
        fail("a state of " + std::to_string(state.size()) + " planes, the film has " +
             std::to_string(planes().size()));
    impl->with_more(samples);
    if (units > samples)
        fail("units = " + std::to_string(units) + " of " + std::to_string(samples) +
             " samples; allowed: as many at most");
    const auto size = [&](size_t i) { return impl->first[i + 1] - impl->first[i]; };
    for (size_t i = 0; i < state.size(); ++i) {
        const PlaneInfo& p = planes()[i];
        if (state[i].info != p)
            fail("plane " + std::to_string(i) + " of the state is " + in_words(state[i].info) +
                 ", of the film " + in_words(p));
        if (!is_scale(p, state[i].scale))
            fail("plane " + in_words(p) + " of the scale " + std::to_string(state[i].scale) +
                 "; allowed: 0, of sums also a power of two from 2^-100 to 2^100");
        impl->check_scale(i, state[i].scale);
        const uint64_t *begin = state[i].words, *end = begin + size(i);
        if (state[i].scale == 0 && p.kind != PlaneKind::kIntegers &&
            std::any_of(begin, end, [](uint64_t word) { return word != 0; }))
            fail("plane " + in_words(p) + " of the state has sums, but no scale");
    }
    for (size_t i = 0; i < state.size(); ++i) {
        impl->memory->add(impl->first[i], size(i), state[i].words);
        impl->match_scale(i, state[i].scale);
    }
    impl->samples += samples;
    impl->units += units;
}

void Film::end_unit(uint32_t n) {
    if (n < 1 || n > kGroupSamples)
        fail("a unit of " + std::to_string(n) + " samples; allowed: 1 to " +
             std::to_string(kGroupSamples));
    impl->memory->end_unit(impl->view(), n);
    impl->units = samples() ? 1 : 0;
}

void Film::sums(double* out) const {
    constexpr size_t kPart = 1 << 16;  // pixels read at a time
    const float unit = scale(0) != 0 ? scale(0) : 1.f;
    const size_t pixels = static_cast<size_t>(width()) * height();
    std::vector<uint64_t> part(std::min(pixels, kPart) * kFilmWords);
    for (size_t at = 0; at < pixels; at += kPart) {
        const size_t n = std::min(kPart, pixels - at);
        impl->memory->read(at * kFilmWords, n * kFilmWords, part.data());
        for (size_t i = 0; i < 3 * n; ++i)
            *out++ = film_sum(&part[i / 3 * kFilmWords], static_cast<uint32_t>(i % 3), unit);
    }
}

void Film::words(size_t plane, uint64_t* out) const {
    impl->memory->read(impl->first[plane], impl->first[plane + 1] - impl->first[plane], out);
}

Picture::Picture(const Film& film, const uint64_t* counts, uint32_t threads, size_t plane,
                 bool units, const Film* tail)
    : impl(std::make_unique<Impl>()) {
    if (tail && (plane || tail->width() != film.width() || tail->height() != film.height() ||
                 tail->impl->device != film.impl->device))
        fail("a tail is the radiance of a film of the same size and device");
    if (plane >= film.planes().size())
        fail("plane " + std::to_string(plane) + " of a film of " +
             std::to_string(film.planes().size()));
    const PlaneInfo& info = film.planes()[plane];
    if (info.kind != PlaneKind::kSumsAndSquares)
        fail("plane " + in_words(info) + " has no squares, so no picture");
    FilmView view = film.impl->view();
    view.words += film.impl->first[plane];
    view.scale = film.scale(plane) != 0 ? film.scale(plane) : 1.f;
    impl->width = film.width(), impl->height = film.height(), impl->device = film.impl->device;
    impl->channels = info.channels, impl->integers = false;
    ErrorSum sum{};
    if (tail) film.impl->check_scale(0, tail->scale(0));
    const SampleCount count{film.samples() + (tail ? tail->samples() : 0),
                            plane ? film.samples() : film.units(), counts, units,
                            tail ? tail->impl->view().words : nullptr};
    impl->memory = film.impl->memory->resolve(view, info.channels, count, threads, sum);
    impl->mean_error = sum.not_finite
                           ? std::numeric_limits<double>::quiet_NaN()
                           : to_double(sum.sum, kSumScale) / static_cast<double>(impl->size()) /
                                 static_cast<double>(view.scale);
}
Picture::Picture(uint32_t width, uint32_t height, uint32_t channels, bool integers, int device)
    : impl(std::make_unique<Impl>()) {
    check_size(width, height);
    check_channels(channels, "a picture of " + std::to_string(channels) + " channels");
    impl->width = width, impl->height = height, impl->channels = channels;
    impl->integers = integers, impl->device = device;
    impl->mean_error = std::numeric_limits<double>::quiet_NaN();
    impl->memory = picture_memory(memory() / sizeof(float), device);
}
Picture::~Picture() = default;
uint32_t Picture::width() const { return impl->width; }
uint32_t Picture::height() const { return impl->height; }
uint32_t Picture::channels() const { return impl->channels; }
bool Picture::integers() const { return impl->integers; }
int Picture::device() const { return impl->device; }
size_t Picture::memory() const { return (integers() ? 1 : 2) * impl->size() * sizeof(float); }
double Picture::mean_error() const { return impl->mean_error; }
void Picture::read_mean(float* out) const { impl->memory->read(0, impl->size(), out); }
Large<float> Picture::mean() const {
    Large<float> out = Spare::common().take(impl->size());
    read_mean(out.data());
    return out;
}
Large<float> Picture::error() const {
    Large<float> out = Spare::common().take(impl->size());
    read_error(out.data());
    return out;
}
void Picture::give_back(Large<float> numbers) noexcept { Spare::common().give(std::move(numbers)); }
void Picture::read_error(float* out) const {
    if (!integers()) impl->memory->read(impl->size(), impl->size(), out);
}
float* Picture::share() {
    impl->memory->share();
    return impl->memory->numbers();
}

}  // namespace veriray
