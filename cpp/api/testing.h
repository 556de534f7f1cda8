// Hooks of the test suite: parts of the stages, run on the back end.
#pragma once

#include "api/renderer.h"

namespace veriray {

// A function of backends/hooks.h by name. x: rows of its inputs; result: rows of its outputs.
std::vector<float> eval_function(const std::string& name, const std::vector<float>& x);
// Columns of its input and output.
std::pair<size_t, size_t> function_shape(const std::string& name);
std::vector<uint32_t> random_words(uint64_t seed, Sampler sampler,
                                   const std::vector<uint32_t>& pixel,
                                   const std::vector<uint64_t>& sample,
                                   const std::vector<uint32_t>& block);
// Adds samples, rows of x, to a film's plane of sums of that scale or of integers, from many
// threads at once. Returns those refused; their `sample` is the row.
FaultLog add_values(Film& film, const std::string& plane, float scale,
                    const std::vector<uint32_t>& pixel, const std::vector<float>& x);
void add_integers(Film& film, const std::string& plane, const std::vector<uint32_t>& pixel,
                  const std::vector<uint64_t>& x);
// Rays in world units; t in world units, primitive of the input (see PathVertex) or -1.
void intersect(const Scene& scene, const double* origins, const double* directions, size_t n,
               float* t, int32_t* primitive);

// The choice among more than one light at points with normals (world units) that face `sides` (see
// Facing), by the numbers u24: the row of the light and its chance, and the chance of `row`.
struct LightQuery {
    std::vector<float> places;  // rows of six, normalised
    std::vector<uint32_t> sides, u24, row;
};
struct LightAnswer {
    std::vector<uint32_t> chosen;
    std::vector<float> chance, of_row;
};
LightAnswer choose_lights(const Scene& scene, const double* points, const double* normals,
                          LightQuery query);
// The records of the scene's tree of lights (lights/tree_view.h), empty for one light; its root's
// branches.
std::pair<std::vector<float>, uint32_t> light_tree(const Scene& scene);

// Rays [first, first + n) of a fixed sequence from interior points (world units) at the corners and
// edges of the scene's triangles; how many hit nothing: {aimed at corners, aimed at edges}.
std::pair<uint64_t, uint64_t> count_leaks(const Scene& scene, const double* origins,
                                          size_t origin_count, uint64_t first, uint64_t n);
// A tree as words: rows of lo, hi (as bits) and child, 7 * width; primitives by slot.
struct TreeWords {
    std::vector<uint32_t> nodes, order;
};
// The scene's tree of 2, 4 or 8 boxes per node, or of as many as the back end has, built anew by
// `ploc` on the host.
TreeWords host_ploc(const Scene& scene, uint32_t width, uint32_t threads);
// The tree that the device holds. CUDA only.
TreeWords device_tree(const Scene& scene);
// As intersect, through a tree of 2, 4 or 8 boxes a node, which the answers do not show; returns
// the kernel's seconds. CUDA only.
double intersect_width(const Scene& scene, uint32_t width, const double* origins,
                       const double* directions, size_t n, float* t, int32_t* primitive);

}  // namespace veriray
