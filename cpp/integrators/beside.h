// Points close to surfaces: finds their side, and puts them back on it.
#pragma once

#include "integrators/surface.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct Beside : SurfaceReader<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Reader::has, Reader::primitive_column, Reader::primitive_column3, Reader::sphere_record;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V;

    // A point close to a primitive: unit normal and height over it, by the arithmetic of the tests,
    // and the size to which its rounding is proportional.
    struct Height {
        V n;
        F height, size;
    };
    static VR_HD Height beside(const SceneView& scene, U prim, V p, M valid) {
        prim = select(valid, prim, U(0u));
        const V n = primitive_column3(scene, prim, kPrimN);
        const F w = -primitive_column(scene, prim, kPrimPlane);
        Height b{n, fma(n.z, p.z, fma(n.y, p.y, fma(n.x, p.x, w))), terms(n, p)};
        if constexpr (has(kSpheres)) {
            const M round = valid & !(prim < U(scene.first_sphere));
            if (any(round)) {
                F record[kSphereFloats];
                sphere_record(scene, prim, record);
                const TwoVec3<F> f = from_centre(record, p);
                b.n = select(round, f.hi * (F(1.f) / sqrt(dot(f.hi, f.hi))), b.n);
                b.height = select(round, excess(record, f) / (F(2.f) * record[6]), b.height);
                b.size = select(round, sqrt(dot(p, p)), b.size);
            }
        }
        return b;
    }

    // The point at t of a ray that has passed a primitive there: moved along the ray onto the
    // primitive, by at most the rounding of t.
    static VR_HD V passed_point(const SceneView& scene, const Ray<L>& ray, F t, U prim, M valid) {
        const V p = ray.at(t);
        const Height b = beside(scene, prim, p, valid);
        const F most = t * F(0x1p-21f);
        return fma(ray.d, max(min(-b.height / dot(b.n, ray.d), most), -most), p);
    }

    // A collision's point p, which the ray reaches before (or, `after`, beyond) its point at t on a
    // primitive. It is put back on that side if rounding has taken it across; otherwise its path
    // would never meet the surface.
    static VR_HD V on_this_side(const SceneView& scene, const Ray<L>& ray, F t, U prim, bool after,
                                V p, M valid) {
        const F towards = dot(beside(scene, prim, ray.at(t), valid).n, ray.d);
        const Height b = beside(scene, prim, p, valid);
        const F front(after ? -1.f : 1.f), side = select(towards < F(0.f), front, -front);
        const M across = valid & !(b.height * side > F(0.f));
        return select(across, fma(b.n * side, fma(b.size, F(0x1p-22f), abs(b.height)), p), p);
    }

    // The point of a collision, a free flight from the surface last passed, before the hit `end`.
    static VR_HD V collision_point(const SceneView& scene, const PathState<L>& path, F flight,
                                   const Hit<L>& end, M collided) {
        const Ray<L> ray = path.ray;
        V p = ray.at(flight);
        if constexpr (has(kPass)) {
            const M begun = collided & (path.travelled > F(0.f));
            if (any(begun)) {
                const V from = passed_point(scene, ray, path.travelled, path.passed, begun);
                p = select(begun, fma(ray.d, flight, from), p);
                p = on_this_side(scene, ray, path.travelled, path.passed, true, p, begun);
            }
        }
        const M met = collided & (end.t < F(kInfinity));
        if (none(met)) return p;
        return on_this_side(scene, ray, end.t, end.primitive, false, p, met);
    }
};

}  // namespace veriray
