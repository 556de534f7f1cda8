// The only header that the bindings include. Implemented once by each backend.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "film/plane.h"
#include "integrators/path_state.h"
#include "scene/normals.h"
#include "scene/obj_text.h"
#include "scene/rgbe.h"
#include "scene/scene.h"

namespace veriray {

struct DeviceError : std::runtime_error {
    using std::runtime_error::runtime_error;
};
struct OutOfMemoryError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

struct BuildInfo {
    std::string backend, isa, compiler, thrust, cuda_toolkit, cuda_architectures;
    uint32_t lanes;
};
struct DeviceInfo {
    std::string name, compute_capability, driver;
    int index;
    uint64_t memory_total, memory_free;
    int multiprocessors;
};

BuildInfo build_info();
// Empty: this module can run here. Otherwise the exact reason why not.
std::string why_unusable();
std::vector<DeviceInfo> devices();

// Features compiled in the variant that renders a scene, and in each variant.
FeatureMask variant_mask(const SceneView& scene);
std::vector<FeatureMask> variant_masks();

struct RenderSettings {
    uint64_t seed = 0, sample_begin = 0, sample_end = 1;
    int64_t max_depth = -1;  // -1: unlimited (kHardMaxDepth)
    uint32_t rr_depth = 5;
    Sampler sampler = Sampler::kSobol;
    std::string scheduler = "fused";
    uint32_t threads = 0;  // 0: all; CPU only
    uint32_t batch = 0;    // paths in flight; 0: the scheduler's choice
    bool all_features = false;
    bool units = false;            // of groups of samples (film/units.h), not each alone
    std::vector<uint32_t> pixels;  // row-major indices, ascending; empty: all
};

struct Fault {
    int32_t x, y;  // where pixels share samples, also beyond the film
    uint64_t sample;
    float radiance[3];
};

// The resources of a multiprocessor that the path-tracing kernel uses; all 0 on a CPU.
struct KernelUse {
    uint32_t registers = 0, local_bytes = 0;  // per thread
    uint32_t resident_threads = 0;
};

struct RenderStats {
    std::vector<uint64_t> ledger;            // [depth][column of LedgerColumn]
    std::vector<uint64_t> blocks;            // by depth; scheduler `thrust`
    std::vector<double> depth_seconds;       // scheduler `thrust`
    std::vector<double> compaction_seconds;  // of these, for the compaction of ended paths
    double seconds = 0;
    uint64_t fault_count = 0;
    std::vector<Fault> faults;
    uint64_t launches = 0;
    std::string device;
    FeatureMask features = 0;  // the compiled variant that ran
    uint32_t threads = 0;
    KernelUse kernel;
};

// Called about every 10 ms on the calling thread with the share done; false stops the render.
using Poll = std::function<bool(double)>;

struct PlaneInfo {
    std::string name;
    PlaneKind kind;
    uint32_t channels;
    bool negative;  // samples below 0 are legitimate; of radiance the integrator decides

    bool operator==(const PlaneInfo&) const = default;
};
// What a plane holds. scale: as in PlaneView, 0 where there are no samples yet, and of integers.
struct PlaneState {
    PlaneInfo info;
    float scale;
    const uint64_t* words;  // [pixel][channel][kPlaneWords of its kind]
};

// Planes of exact sums, `radiance` first: sums and squares of three channels.
class Film {
   public:
    Film(uint32_t width, uint32_t height, int device, const std::vector<PlaneInfo>& more = {});
    ~Film();
    Film(const Film&) = delete;
    Film& operator=(const Film&) = delete;

    uint32_t width() const;
    uint32_t height() const;
    uint64_t samples() const;  // of every pixel; renders of listed pixels do not count
    uint64_t units() const;    // of these samples (film/units.h)
    size_t memory() const;
    void clear();
    void add(const Film& other);  // exact: independent of the order of additions
    // The same for what a film held, on any device: its samples(), units() and planes in
    // order. Adds nothing where that does not fit (std::invalid_argument).
    void add(uint64_t samples, uint64_t units, const std::vector<PlaneState>& planes);
    // All samples of radiance become one unit, of n samples of each pixel that has some.
    void end_unit(uint32_t n);
    const std::vector<PlaneInfo>& planes() const;
    float scale(size_t plane) const;
    void words(size_t plane, uint64_t* out) const;
    void sums(double* out) const;

    struct Impl;
    std::unique_ptr<Impl> impl;
};

// Means of a plane and their standard errors, width * height * channels() numbers each, row 0 on
// top, in memory of the film's device; or integers without errors. Does not need the film any more.
class Picture {
   public:
    // counts: samples by pixel; null: samples() of each. threads: as of RenderSettings. plane: one
    // with squares; 0 is radiance. units: the samples by pixel are in units of kGroupSamples.
    // tail: or null; what the film lacks of the last unit of each pixel, which is cut there.
    Picture(const Film& film, const uint64_t* counts, uint32_t threads, size_t plane = 0,
            bool units = false, const Film* tail = nullptr);
    // Without numbers yet: see put_features.
    Picture(uint32_t width, uint32_t height, uint32_t channels, bool integers, int device);
    ~Picture();
    Picture(const Picture&) = delete;
    Picture& operator=(const Picture&) = delete;

    uint32_t width() const;
    uint32_t height() const;
    uint32_t channels() const;
    bool integers() const;
    int device() const;
    size_t memory() const;
    // The mean of the standard errors, each rounded to 2^-72 of the largest radiance; the same on
    // every device. NaN if one of them is not finite, and of features.
    double mean_error() const;
    // Of integers their bits.
    void read_mean(float* out) const;
    // The same, of pictures that have errors, in memory for them.
    Large<float> mean() const, error() const;
    // What these gave, for the next picture; no thread waits.
    static void give_back(Large<float> numbers) noexcept;
    void read_error(float* out) const;
    // The means where the device has them, for others to read: their memory then waits for all
    // work on the device before it is used again.
    float* share();

    struct Impl;
    std::unique_ptr<Impl> impl;
};

struct TreeInfo {
    std::string builder;
    uint32_t width = 0, depth = 0;  // width 0: the scene has no tree
    size_t nodes = 0, references = 0, memory = 0;
    double cost = 0, seconds = 0;  // see WideTree; CUDA: once the primitives are on the device
};

class Scene {
   public:
    // owner: keeps the input's arrays. builder: of kTreeBuilders; the films do not depend on it.
    // poll: progress of the tree's build; false stops it (std::runtime_error).
    Scene(const SceneInput& in, std::shared_ptr<const void> owner, int device,
          const std::string& builder, const BuildPoll& poll);
    ~Scene();
    Scene(const Scene&) = delete;
    Scene& operator=(const Scene&) = delete;

    // The scene of `in`, with the bits of one made anew. It shares with this one the tables, the
    // tree and the device memory that both have in common. Null where the primitives differ
    // (HostScene::change).
    std::unique_ptr<Scene> changed(const SceneInput& in, std::shared_ptr<const void> owner,
                                   bool rough) const;
    // This scene with a tree by another builder; they share the rest.
    std::unique_ptr<Scene> rebuilt(const std::string& tree_builder, const BuildPoll& poll) const;

    const HostScene& host() const;
    TreeInfo tree() const;
    // The same for scenes that share their primitives and tree.
    const void* family() const;

    struct Impl;
    std::unique_ptr<Impl> impl;
    const SceneInput input;
    const std::shared_ptr<const void> owner;

   private:
    Scene(std::unique_ptr<Impl> made, const SceneInput& in, std::shared_ptr<const void> owner);
};

// Adds the machine code of a scheduler's kernels for exactly these features (backends/run_time/),
// which scenes that need these are rendered by from then on. CUDA back end only; DeviceError where
// it does not load.
void add_kernels(int device, FeatureMask features, const std::string& code);

RenderStats render(const Scene& scene, Film& film, const RenderSettings& settings,
                   const Poll& poll);

// What feature images need beside seed, samples, sampler and threads of the settings. first_row: of
// the scene's, at which the film begins. motion: rows that take a point of the world to x, y and w
// of its pixel in the first and in the second camera.
struct FeatureSettings : RenderSettings {
    uint32_t first_row = 0;
    double motion[2][3][4] = {};
};
// Adds samples of the film's planes that are feature images (kFeatureInfos), the numbers of those
// samples that met something (kHitsPlane), and, with sample 0, what the pixels' centres show
// (kPrimitivePlane). The film's planes beside these, and its samples(), stay as they are.
RenderStats render_features(const Scene& scene, Film& film, const FeatureSettings& settings,
                            const Poll& poll);

// Puts what a film of features holds into pictures of its width, from their row `first_row` on, in
// units of the world: means with their errors over the samples that met something; of kHitsPlane
// the share of `samples` with its error; of kPrimitivePlane the integers. pictures: by plane,
// without radiance; null: not wanted.
void put_features(const Scene& scene, const Film& film, const std::vector<Picture*>& pictures,
                  uint32_t first_row, uint64_t samples, uint32_t threads);

// One path, vertex by vertex. CPU backends only.
struct PathVertex {
    uint32_t depth;
    std::string event;
    double position[3];                // world; the ray's origin shifted by t if it escaped
    float direction[3], normal[3], t;  // of the segment; world t
    float throughput[3], radiance[3];  // before the vertex, after the vertex
    int64_t primitive;                 // triangle, T + sphere or T + S + disk of the input; -1 none
    int shadow;                        // -1 none, 0 occluded, 1 visible
};
std::vector<PathVertex> trace_path(const Scene& scene, const RenderSettings& settings, uint32_t x,
                                   uint32_t y, uint64_t sample);

}  // namespace veriray
