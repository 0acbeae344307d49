"""A path tracer whose media absorb by Beer and Lambert's law, without chance.

Mitsuba's own integrators decide by chance where a path is absorbed, which leaves dots on tinted
glass.
"""

from functools import cache
from typing import Any

from pmcl_ros.simulation.path_tracing.variant import mitsuba

BOUNCES = 24  # surfaces on one path at most, as in the package's own renderer
SURE = 6  # surfaces after which faint paths end by chance
# Attributes of meshes: absorption of red, green, blue [1/m] behind a surface and before it.
BEHIND, BEFORE = 'vertex_behind', 'vertex_before'


def radiance(scene: Any, sampler: Any, ray: Any) -> Any:
    """The light (red, green, blue) that comes along each ray: a wavefront of Mitsuba's.

    Unidirectional: at each surface one direction by its material and one to a light, with multiple
    importance sampling by the power heuristic (Veach, Optimally combining sampling techniques,
    1995). Runs where Mitsuba is compiled.
    """
    import drjit as dr
    return _follower()(mitsuba(), dr, scene, sampler, ray)


@cache
def _follower() -> Any:
    """Translated once: Dr.Jit rewrites the function's syntax, which takes its time."""
    import drjit as dr

    @dr.syntax
    def follow(mi, dr, scene, sampler, ray):  # type: ignore[no-untyped-def]
        context = mi.BSDFContext()
        light, weight = mi.Color3f(0), mi.Color3f(1)
        depth, active = mi.UInt32(0), mi.Bool(True)
        before, density, is_sharp = dr.zeros(mi.Interaction3f), mi.Float(1), mi.Bool(True)
        ray = mi.Ray3f(ray)
        while active:
            hit = scene.ray_intersect(ray, active)
            leaves = dr.dot(ray.d, hit.n) > 0
            absorbed = dr.select(leaves, hit.shape.eval_attribute_3(BEHIND, hit, active),
                                 hit.shape.eval_attribute_3(BEFORE, hit, active))
            weight *= dr.select(hit.is_valid(), dr.exp(-absorbed * hit.t), 1)
            source = mi.DirectionSample3f(scene, hit, before)
            other = scene.pdf_emitter_direction(before, source, ~is_sharp & active)
            both = density * density + other * other
            share = dr.select(is_sharp, 1, dr.select(both > 0, density * density / both, 0))
            light += weight * share * dr.select(active, source.emitter.eval(hit, active), 0)
            active &= hit.is_valid() & (depth < BOUNCES)
            material = hit.bsdf()
            takes_light = active & mi.has_flag(material.flags(), mi.BSDFFlags.Smooth)
            lamp, brought = scene.sample_emitter_direction(hit, sampler.next_2d(), True,
                                                           takes_light)
            takes_light &= lamp.pdf > 0
            value, pdf = material.eval_pdf(context, hit, hit.to_local(lamp.d), takes_light)
            share = lamp.pdf * lamp.pdf / (lamp.pdf * lamp.pdf + pdf * pdf)
            light += dr.select(takes_light, weight * share * value * brought, 0)
            out, value = material.sample(context, hit, sampler.next_1d(), sampler.next_2d(),
                                         active)
            weight *= dr.select(active & (out.pdf > 0), value, 0)
            before, density = mi.Interaction3f(hit), out.pdf
            is_sharp = mi.has_flag(out.sampled_type, mi.BSDFFlags.Delta) | mi.has_flag(
                out.sampled_type, mi.BSDFFlags.Null)
            ray = hit.spawn_ray(hit.to_world(out.wo))
            depth += 1
            brightest = dr.max(weight)
            active &= brightest > 0
            kept = dr.select(depth > SURE, dr.minimum(brightest, 0.95), 1)
            active &= sampler.next_1d() < kept
            weight /= kept
        return dr.select(dr.isfinite(light), light, 0)  # of a mesh's flattest triangles it is not

    return follow
