#version 330
// Which object a pixel shows, and how far along the optical axis. Leaves of props are seen through as in colour.
uniform float object;
uniform vec4 optical_axis;  // row of camera_from_world
uniform sampler2D noise;
in vec3 position;
#ifdef PROP
in vec3 place;
in float leaves;
#endif
out vec2 seen;

void main() {
#ifdef PROP
    vec2 q = place.xy * vec2(0.41, 0.53) + place.z * vec2(0.37, 0.29);
    float grain = texture(noise, q).g, cloud = texture(noise, q * 0.6).r;
    if (leaves > 0.0 && grain + 0.6 * cloud < 0.8 * leaves + 0.15) discard;
#endif
    seen = vec2(object, dot(optical_axis, vec4(position, 1.0)));
}
