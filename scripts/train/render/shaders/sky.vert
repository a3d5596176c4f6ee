#version 330
uniform mat4 world_from_clip;
in vec2 in_corner;
out vec3 far_point;

void main() {
    vec4 p = world_from_clip * vec4(in_corner, 0.999, 1.0);
    far_point = p.xyz / p.w;
    gl_Position = vec4(in_corner, 0.99999, 1.0);
}
