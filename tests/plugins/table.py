# ruff: noqa: E501 (a table)
"""Every parameter of every plugin of Mitsuba 3.9.1, after its documentation, with the kinds of values that it takes.

A plugin's line: category, name, parameters; a parameter: name:kinds. Kinds are named in `values`; "=" gives the value
of a string. A "+" is an object that the plugin holds: "+bsdf", or "+name=category.plugin" where it has a name.
"""

_MESH = "filename:file face_normals:boolean flip_normals:boolean to_world:transform silhouette_sampling_weight:float"
_ROUGH = "distribution:string=ggx,string=beckmann alpha:float,texture sample_visible:boolean"
_ALPHAS = "alpha_u:both,texture_both"
_GLASS = (
    "int_ior:float,string=water ext_ior:float,string=air specular_reflectance:rgb,float,spectrum,texture "
    "specular_transmittance:rgb,texture"
)
_METAL = "material:string=Au,string=none eta:metal specular_reflectance:rgb,float,spectrum,texture"
_RUN = "samples_per_pass:integer timeout:float block_size:integer"
_DEPTH = "max_depth:integer rr_depth:integer hide_emitters:boolean"
_DEPTHS = f"{_DEPTH} {_RUN}"
_SHUTTER = "shutter_close:shutter srf:spectrum"
_CLIP = "near_clip:float far_clip:far focus_distance:float"
_LENS = (
    "fov:float focal_length:focal fov_axis:string=x,string=y,string=diagonal,string=smaller,string=larger "
    f"to_world:transform {_CLIP} {_SHUTTER}"
)
_SIZE = (
    "width:integer height:integer crop_width:crop component_format:string=float16,string=float32,string=uint32 "
    "sample_border:boolean compensate:boolean"
)
_RATES = "diffuse_reflectance_sampling_rate:float"
_DISNEY = (
    "base_color:rgb,float,spectrum,texture roughness:float,texture anisotropic:float,texture spec_trans:float,texture "
    "eta:index spec_tint:float,texture sheen:float,texture sheen_tint:float,texture flatness:float,texture"
)
_SUN = (
    "turbidity:turbidity albedo:rgb,float,spectrum latitude:float longitude:float timezone:float sun_scale:float "
    "sky_scale:float sun_aperture:float complex_sun:boolean to_world:transform sampling_weight:float"
)
_PROJECTIVE = "sppc:integer sppp:integer sppi:integer guiding:string=grid,string=octree,string=none guiding_proj:boolean guiding_rounds:integer"
_GAUSSIANS = "filename:file scale_factor:float extent:float extent_adaptive_clamping:boolean to_world:transform"
_RANGE = "wavelength_min:range"

TABLE = f"""
bsdf blendbsdf +bsdf +bsdf weight:required,texture
bsdf bumpmap +bsdf +texture scale:float flip_invalid_normals:boolean use_shadowing_function:boolean
bsdf circular transmittance:rgb,float left_handed:boolean
bsdf conductor {_METAL}
bsdf dielectric {_GLASS}
bsdf diffuse reflectance:rgb,float,spectrum,texture
bsdf hair eumelanin:float pheomelanin:float sigma_a:rgb int_ior:float,string=water ext_ior:float longitudinal_roughness:float azimuthal_roughness:float scale_tilt:float scale:float
bsdf mask +bsdf opacity:float,texture
bsdf measured filename:file
bsdf measured_polarized filename:file alpha_sample:float wavelength:float
bsdf normalmap +normalmap=texture.bitmap +bsdf flip_invalid_normals:boolean use_shadowing_function:boolean
bsdf null
bsdf plastic diffuse_reflectance:rgb,float,spectrum,texture nonlinear:boolean int_ior:float,string=water ext_ior:float,string=air specular_reflectance:rgb,texture
bsdf polarizer theta:float,texture transmittance:rgb,float polarizing:boolean
bsdf pplastic diffuse_reflectance:rgb,float,spectrum,texture specular_reflectance:rgb,texture int_ior:float ext_ior:float distribution:string=ggx,string=beckmann alpha:float {_ALPHAS.split(",")[0]} sample_visible:boolean
bsdf principled {_DISNEY} metallic:float,texture specular:float clearcoat:float,texture clearcoat_gloss:float,texture {_RATES} main_specular_sampling_rate:float clearcoat_sampling_rate:float
bsdf principledthin {_DISNEY} diff_trans:float,texture {_RATES} diffuse_transmittance_sampling_rate:float specular_reflectance_sampling_rate:float specular_transmittance_sampling_rate:float
bsdf retarder theta:float,texture delta:float,texture transmittance:rgb,float
bsdf roughconductor {_METAL} {_ROUGH} {_ALPHAS}
bsdf roughdielectric {_GLASS} {_ROUGH} {_ALPHAS}
bsdf roughplastic diffuse_reflectance:rgb,float,spectrum,texture nonlinear:boolean int_ior:float,string=water ext_ior:float,string=air specular_reflectance:rgb,texture distribution:string=ggx,string=beckmann alpha:float sample_visible:boolean
bsdf thindielectric {_GLASS}
bsdf twosided +bsdf bsdf:second
emitter area radiance:rgb,float,spectrum,texture sampling_weight:float
emitter constant radiance:rgb,float,spectrum sampling_weight:float
emitter directional irradiance:rgb,float,spectrum direction:vector to_world:transform sampling_weight:float
emitter directionalarea radiance:rgb,float,spectrum sampling_weight:float
emitter envmap filename:file scale:float to_world:rotation mis_compensation:boolean sampling_weight:float
emitter point intensity:rgb,float,spectrum position:point to_world:transform sampling_weight:float
emitter projector +irradiance=texture.bitmap irradiance:- scale:float to_world:rotation fov:float fov_axis:string=x,string=y,string=diagonal,string=smaller,string=larger sampling_weight:float
emitter spot intensity:rgb,float,spectrum cutoff_angle:angle beam_width:float texture:texture to_world:rotation sampling_weight:float
emitter sunsky {_SUN} sun_direction:vector year:integer month:integer day:integer hour:float minute:float second:float
emitter timed_sunsky {_SUN} start_year:integer start_month:integer start_day:integer end_year:integer end_month:integer end_day:integer window_start_time:float window_end_time:float
film hdrfilm {_SIZE} file_format:string=openexr,string=pfm,string=rgbe pixel_format:string=rgb,string=rgba,string=luminance,string=luminance_alpha,string=xyz,string=xyza banner:boolean
film specfilm +spectrum {_SIZE}
integrator aov +integrator aovs:string=dd.y:depth,string=nn:sh_normal,string=albedo:albedo
integrator depth {_RUN}
integrator direct shading_samples:integer emitter_samples:one bsdf_samples:one hide_emitters:boolean {_RUN}
integrator direct_projective {_PROJECTIVE} hide_emitters:boolean
integrator moment +integrator
integrator path {_DEPTHS}
integrator prb {_DEPTHS}
integrator prb_basic {_DEPTHS}
integrator prb_projective {_DEPTHS} {_PROJECTIVE}
integrator prbvolpath {_DEPTHS}
integrator ptracer {_DEPTH} samples_per_pass:integer timeout:float
integrator stokes +integrator
integrator volpath {_DEPTHS}
integrator volpathmis {_DEPTHS} use_spectral_mis:boolean
integrator volprim_rf_basic {_DEPTHS}
medium heterogeneous albedo:float,rgb,volume sigma_t:float,volume scale:float sample_emitters:boolean has_spectral_extinction:boolean
medium homogeneous albedo:float,rgb,spectrum,volume sigma_t:float,rgb,spectrum scale:float sample_emitters:boolean has_spectral_extinction:boolean
phase blendphase +phase +phase weight:required
phase hg g:float
phase isotropic
phase rayleigh
phase sggx S:gridvolume
phase tabphase values:values
rfilter box
rfilter catmullrom
rfilter gaussian stddev:float
rfilter lanczos lobes:integer
rfilter mitchell B:float C:float
rfilter tent radius:radius
sampler independent sample_count:integer seed:integer
sampler ldsampler sample_count:integer seed:integer
sampler multijitter sample_count:integer seed:integer jitter:boolean
sampler orthogonal sample_count:square seed:integer jitter:boolean
sampler stratified sample_count:square seed:integer jitter:boolean
sensor batch +sensor +sensor
sensor distant direction:vector to_world:transform target:point,shape
sensor irradiancemeter
sensor orthographic to_world:transform {_CLIP} {_SHUTTER}
sensor perspective {_LENS} principal_point_offset_x:float principal_point_offset_y:float
sensor radiancemeter origin:ray to_world:transform {_SHUTTER}
sensor thinlens aperture_radius:required {_LENS}
shape bsplinecurve filename:file to_world:transform silhouette_sampling_weight:float
shape cube to_world:transform flip_normals:boolean face_normals:boolean bsdf:bsdf emitter:area interior:medium exterior:medium
shape cylinder p0:point p1:point radius:float flip_normals:boolean to_world:transform silhouette_sampling_weight:float emitter:area
shape disk flip_normals:boolean to_world:transform silhouette_sampling_weight:float
shape ellipsoids {_GAUSSIANS}
shape ellipsoidsmesh {_GAUSSIANS} shell:string=box,string=ico_sphere,string=uv_sphere
shape instance +group to_world:transform
shape linearcurve filename:file to_world:transform silhouette_sampling_weight:float
shape merge +shape
shape obj {_MESH} flip_tex_coords:boolean
shape ply {_MESH} flip_tex_coords:boolean
shape rectangle flip_normals:boolean face_normals:boolean to_world:transform silhouette_sampling_weight:float
shape sdfgrid filename:file to_world:transform normals:string=smooth,string=analytic silhouette_sampling_weight:float
shape serialized {_MESH} shape_index:zero
shape shapegroup +shape
shape sphere center:point radius:float flip_normals:boolean to_world:transform silhouette_sampling_weight:float emitter:area
spectrum blackbody temperature:required {_RANGE}
spectrum d65 color:rgb scale:float
spectrum irregular wavelengths:values
spectrum rawconstant value:required,vector
spectrum regular wavelength_min:values
spectrum srgb color:rgb unbounded:-
spectrum uniform value:float {_RANGE}
texture bitmap filename:file filter_type:string=bilinear,string=nearest wrap_mode:string=repeat,string=mirror,string=clamp format:string=auto,string=variant,string=fp16 raw:boolean to_uv:uv accel:boolean
texture checkerboard color0:rgb,float,spectrum,texture color1:rgb,float,spectrum,texture to_uv:uv
texture mesh_attribute name:attribute scale:float
texture volume volume:constvolume,gridvolume
volume constvolume value:required,rgb
volume gridvolume filename:file filter_type:string=trilinear,string=nearest wrap_mode:string=repeat,string=mirror,string=clamp raw:boolean to_world:transform use_grid_bbox:boolean max_value:float accel:boolean
"""
