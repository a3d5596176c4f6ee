#version 330
// Shared by all colour shaders. Light is linear; a white surface in full sun has radiance of about 1.
const int MAX_CARS = 48;
uniform vec3 camera_position;
uniform vec3 to_sun;
uniform vec3 sun;
uniform vec3 sky;
uniform vec3 ground_radiance;  // of the open ground, for mirrors and light from below
uniform float sun_mirror;
uniform float dapple;
uniform float haze;
uniform float exposure;
uniform float shadow_softness;  // as a share of the shadow map
uniform mat4 shadow_from_world;
uniform sampler2D noise;
uniform sampler2D environment;
uniform sampler2DShadow shadow_map;
uniform vec4 car_place[MAX_CARS];  // x, y, cos, sin of heading
uniform vec3 car_extent[MAX_CARS];  // half length, half width, centre's x in the car frame
uniform int car_count;

vec3 mirrored(vec3 direction, float blur) {
    vec2 at = vec2(atan(direction.y, direction.x) / 6.2831853 + 0.5,
                   asin(clamp(direction.z, -1.0, 1.0)) / 3.14159265 + 0.5);
    vec4 seen = textureLod(environment, at, blur);
    return seen.rgb * sky + seen.a * ground_radiance;
}

float lit(vec3 position, vec3 normal) {
    if (sun.g <= 0.0) return 0.0;
    vec4 at = shadow_from_world * vec4(position + normal * 0.03, 1.0);
    vec3 p = at.xyz * 0.5 + 0.5;
    float light = 1.0;
    if (all(greaterThan(p, vec3(0.0))) && all(lessThan(p, vec3(1.0)))) {
        float r = shadow_softness;
        p.z -= 0.0008;
        light = 0.2 * (texture(shadow_map, p)
            + texture(shadow_map, p + vec3(r, 0.4 * r, 0)) + texture(shadow_map, p + vec3(-0.4 * r, r, 0))
            + texture(shadow_map, p + vec3(-r, -0.4 * r, 0)) + texture(shadow_map, p + vec3(0.4 * r, -r, 0)));
    }
    if (dapple > 0.0) {
        vec2 q = (position.xy - to_sun.xy / max(to_sun.z, 0.2) * position.z) / 7.0;
        light *= 1.0 - dapple * smoothstep(0.44, 0.54, texture(noise, q).r);
    }
    return light;
}

// Share of the sky that cars nearby leave at a point; `self` is the car it belongs to, or -1.
float open_sky(vec3 position, int self) {
    float open = 1.0;
    for (int i = 0; i < car_count; i++) {
        if (i == self) continue;
        vec2 d = position.xy - car_place[i].xy;
        vec2 q = vec2(dot(d, car_place[i].zw), dot(d, vec2(-car_place[i].w, car_place[i].z)));
        q.x -= car_extent[i].z;
        vec2 outside = abs(q) - car_extent[i].xy + 0.25;
        float gap = length(max(outside, 0.0)) + min(max(outside.x, outside.y), 0.0);
        float low = clamp(1.0 - position.z / 1.3, 0.0, 1.0);
        open *= 1.0 - low * (gap < 0.0 ? mix(0.62, 0.95, clamp(-gap / 0.45, 0.0, 1.0)) : 0.62 * exp(-gap * 2.6));
    }
    return open;
}

// The curve of a camera.
vec3 toned(vec3 c) {
    c = pow(1.0 - exp(-1.2 * c * exposure), vec3(1.0 / 2.2));
    return mix(c, c * c * (3.0 - 2.0 * c), 0.45);  // the contrast of a camera's picture style
}

float air_share(vec3 position) {
    return 1.0 - exp(-haze * length(position - camera_position));
}

vec3 developed(vec3 radiance, vec3 position) {
    return toned(mix(radiance, sky * 1.3 + sun * 0.15, air_share(position)));
}

// The colour of a pane that is blended over its background with the weight `cover`. The background already has the
// light of the air before it, so the pane gets its share alone.
vec3 developed_pane(vec3 radiance, vec3 position, float cover) {
    float air = air_share(position);
    return toned(radiance * (1.0 - air)) + cover * toned((sky * 1.3 + sun * 0.15) * air);
}
