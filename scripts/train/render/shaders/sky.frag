uniform float least_rise;
in vec3 far_point;
out vec4 colour;

void main() {
    vec3 direction = normalize(far_point - camera_position);
    direction.z = max(direction.z, least_rise);
    colour = vec4(developed(mirrored(direction, 0.0), camera_position), 1.0);
}
